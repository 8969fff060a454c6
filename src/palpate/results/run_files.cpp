#include "palpate/results/run_files.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <system_error>

#include "palpate/devices/motion_recording.h"
#include "palpate/record/csv_writer.h"
#include "palpate/record/hdf5_writer.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/report.h"
#include "palpate/record/space_reserve.h"
#include "palpate/results/statistics.h"

namespace palpate {
namespace {

constexpr double kMuchMade = 1e-3;     // energy made by the steps that is worth saying [J]
constexpr double kMuchClamped = 0.01;  // share of the ticks that is worth saying
constexpr double kMuchStale = 0.01;    // share of the ticks from which on a row is red; likewise below
constexpr double kMuchMissed = 0.01;
constexpr double kMuchOverrun = 0.05;         // of the visual steps
constexpr std::uintmax_t kReserve = 2 << 20;  // for what is written last [bytes]
constexpr std::int64_t kFlushEvery = 500;     // ticks

const std::vector<std::string> kMotionColumns{"time_s", "x_m",      "y_m",      "z_m",      "qw",
                                              "qx",     "qy",       "qz",       "vx_m_s",   "vy_m_s",
                                              "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s", "buttons"};
const std::vector<std::string> kHapticColumns{
    "time_s",     "device_x_m", "device_y_m", "device_z_m",  "device_qw", "device_qx", "device_qy", "device_qz",
    "proxy_x_m",  "proxy_y_m",  "proxy_z_m",  "proxy_qw",    "proxy_qx",  "proxy_qy",  "proxy_qz",  "raw_fx_N",
    "raw_fy_N",   "raw_fz_N",   "raw_tx_Nm",  "raw_ty_Nm",   "raw_tz_Nm", "sent_fx_N", "sent_fy_N", "sent_fz_N",
    "sent_tx_Nm", "sent_ty_Nm", "sent_tz_Nm", "model_age_s", "flags"};
const std::vector<std::string> kVisualColumns{"time_s",
                                              "handle_x_m",
                                              "handle_y_m",
                                              "handle_z_m",
                                              "handle_qw",
                                              "handle_qx",
                                              "handle_qy",
                                              "handle_qz",
                                              "coupling_fx_N",
                                              "coupling_fy_N",
                                              "coupling_fz_N",
                                              "coupling_tx_Nm",
                                              "coupling_ty_Nm",
                                              "coupling_tz_Nm",
                                              "contacts_found",
                                              "contacts",
                                              "contacts_active",
                                              "contacts_sticking",
                                              "contacts_sliding",
                                              "penetration_m",
                                              "solver_iterations",
                                              "solver_residual_m_s",
                                              "passes",
                                              "kinetic_energy_J",
                                              "elastic_energy_J",
                                              "status",
                                              "motion_share",
                                              "redone",
                                              "converged",
                                              "energy_made_J",
                                              "energy_corrected_J"};
const std::vector<std::string> kAttachmentColumns{"time_s", "body",  "attachment", "fx_N", "fy_N",
                                                  "fz_N",   "tx_Nm", "ty_Nm",      "tz_Nm"};
const std::vector<std::string> kTimingColumns{"time_s",       "step_ms",          "assemble_ms",
                                              "factorize_ms", "solve_ms",         "contact_ms",
                                              "advance_ms",   "linearization_ms", "lateness_ms"};

/// Of nobody's interest.
class NoTable : public TableWriter {
 public:
  void endRow() override {}
  void flush() override {}
  void close() override {}

 private:
  void put(double) override {}
  void put(std::string_view) override {}
  void put(std::int64_t) override {}
};

/// NAME.csv or NAME.h5 in the folder.
std::unique_ptr<TableWriter> tableFor(OutputFolder& folder, const std::string& name, RunTables tables,
                                      const std::vector<std::string>& columns) {
  switch (tables) {
    case RunTables::csv:
      return std::make_unique<CsvWriter>(folder.stage(name + ".csv"), columns);
    case RunTables::hdf5:
      return std::make_unique<Hdf5Writer>(folder.stage(name + ".h5"), columns);
    case RunTables::none:
      break;
  }
  return std::make_unique<NoTable>();
}

void addPose(TableWriter& csv, const Pose& pose) {
  for (int k = 0; k < 3; ++k) csv.cell(pose.position[k]);
  csv.cell(pose.rotation.w()).cell(pose.rotation.x()).cell(pose.rotation.y()).cell(pose.rotation.z());
}

void addVector(TableWriter& csv, const Vec6& v) {
  for (int k = 0; k < 6; ++k) csv.cell(v[k]);
}

const char* statusName(StepStatus status) {
  switch (status) {
    case StepStatus::ok:
      return "ok";
    case StepStatus::contact_not_converged:
      return "contact_not_converged";
    case StepStatus::restored:
      return "restored";
  }
  return "";
}

Plot vectorPlot(const std::string& title, const std::string& label, const std::vector<double>& x,
                const std::vector<Vec6>& values, int first, const std::string& group, const std::string& note) {
  Plot plot;
  plot.title = title;
  plot.y_label = label;
  plot.x = x;
  plot.group = group;
  plot.note = note;
  const std::array<const char*, 3> names{"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    Series s;
    s.name = names[k];
    for (const Vec6& v : values) s.values.push_back(v[first + k]);
    plot.series.push_back(std::move(s));
  }
  return plot;
}

// Three digits, never an exponent: what is below a thousandth counts as nothing.
std::string plain(std::initializer_list<double> values) {
  std::string out;
  for (const double v : values) {
    if (!out.empty()) out += ", ";
    out += std::abs(v) < 5e-4 ? "0" : std::abs(v) < 999.5 ? fmt::format("{:.3g}", v) : fmt::format("{:.0f}", v);
  }
  return out;
}

}  // namespace

struct RunFiles::Impl {
  Impl(const std::filesystem::path& path, const SceneConfig& scene_config, const RunFilesSettings& run_settings)
      : config(scene_config),
        settings(run_settings),
        folder(path),
        reserve(path / fmt::format(".reserve.partial-{}", ::getpid()), kReserve),
        haptic(tableFor(folder, "haptic", settings.tables, kHapticColumns)),
        motion(tableFor(folder, "motion", besides(), kMotionColumns)),
        visual(tableFor(folder, "visual", settings.tables, kVisualColumns)),
        timing(tableFor(folder, "timing", besides(), kTimingColumns)) {}

  RunTables besides() const { return settings.tables == RunTables::none ? RunTables::none : RunTables::csv; }

  // What cannot be written ends the recording, and nothing else.
  template <class Write>
  bool attempt(Write&& write) {
    try {
      write();
      return true;
    } catch (const std::exception& e) {
      if (failure.empty()) failure = e.what();
      reserve.release();
      return false;
    }
  }

  // So that no more than half a second of a run in real time is lost, whatever happens.
  void flush() {
    for (TableWriter* table : tables()) attempt([table] { table->flush(); });
  }

  std::array<TableWriter*, 4> tables() const { return {haptic.get(), motion.get(), visual.get(), timing.get()}; }

  void tick(const TickRecord& r) {
    if (!failure.empty()) return;
    attempt([&] { writeMotion(r); });
    attempt([&] { writeHaptic(r); });
    tally(r);
    if (ticks % kFlushEvery == 0) flush();
  }

  void writeMotion(const TickRecord& r) {
    motion->cell(r.time);
    addPose(*motion, r.device.pose);
    addVector(*motion, r.device.twist);
    motion->cell(r.device.buttons);
    motion->endRow();
  }

  void writeHaptic(const TickRecord& r) {
    haptic->cell(r.time);
    addPose(*haptic, r.device.pose);
    addPose(*haptic, r.proxy);
    addVector(*haptic, r.raw);
    addVector(*haptic, r.sent);
    haptic->cell(r.model_age).cell(r.flags.bits());
    haptic->endRow();
  }

  void tally(const TickRecord& r) {
    const double force = r.sent.head<3>().norm();
    peak_force = std::max(peak_force, force);
    if (config.device.limits.peak_torque <= 0.0) {
      const double torque = r.raw.tail<3>().norm();
      lost_torque_peak = std::max(lost_torque_peak, torque);
      lost_torque_squares += torque * torque;
    }
    force_squares += force * force;
    ++ticks;
    // the report's plots: every fifth tick, or fewer for long runs, is more than a screen shows
    if (ticks % plot_stride == 1 || plot_stride == 1) {
      plot_time.push_back(r.time);
      plot_raw.push_back(r.raw);
      plot_sent.push_back(r.sent);
      plot_device.push_back(r.device.pose.position);
      plot_proxy.push_back(r.proxy.position);
    }
  }

  void step(const VisualRecord& r) {
    if (!failure.empty()) return;
    attempt([&] { writeVisual(r); });
    attempt([&] { writeTiming(r); });
    tally(r);
  }

  void writeVisual(const VisualRecord& r) {
    visual->cell(r.time);
    addPose(*visual, r.model.handle_pose);
    addVector(*visual, r.model.force);
    visual->cell(r.step.contacts_found)
        .cell(r.step.contacts)
        .cell(r.step.active)
        .cell(r.step.sticking)
        .cell(r.step.sliding);
    visual->cell(r.step.penetration).cell(r.step.solver_iterations).cell(r.step.solver_residual).cell(r.step.passes);
    visual->cell(r.step.kinetic_energy).cell(r.step.elastic_energy).cell(statusName(r.step.status));
    visual->cell(r.step.motion_share).cell(r.step.redone).cell(r.step.converged ? 1 : 0).cell(r.step.energy_made);
    visual->cell(r.step.energy_corrected);
    visual->endRow();
  }

  static double totalOf(const VisualRecord& r) { return r.step.times.total() + r.linearization_s; }

  void writeTiming(const VisualRecord& r) {
    timing->cell(r.time);
    for (const double s : {totalOf(r), r.step.times.assemble, r.step.times.factorize, r.step.times.solve,
                           r.step.times.contact, r.step.times.advance, r.linearization_s, r.lateness_s}) {
      timing->cell(1e3 * s);
    }
    timing->endRow();
  }

  void tally(const VisualRecord& r) {
    const double total = totalOf(r);
    step_time.push_back(r.time);
    step_ms.push_back(1e3 * total);
    linearization_ms.push_back(1e3 * r.linearization_s);
    active.push_back(r.step.active);
    contacts.push_back(r.step.contacts);
    sliding.push_back(r.step.sliding);
    penetration_mm.push_back(1e3 * r.step.penetration);
    kinetic.push_back(r.step.kinetic_energy);
    elastic.push_back(r.step.elastic_energy);
    max_residual = std::max(max_residual, r.step.solver_residual);
    if (r.step.active > 0) {
      step_ms_contact.push_back(1e3 * total);
      linearization_ms_contact.push_back(1e3 * r.linearization_s);
      const ReductionTimes& t = r.reduction;
      for (const auto& [name, seconds] :
           {std::pair("factorize", t.factorize), std::pair("modes", t.modes), std::pair("search", t.search),
            std::pair("partners", t.partners), std::pair("replay", t.replay)}) {
        reduction_ms_contact[name].push_back(1e3 * seconds);
      }
    }
    if (r.step.status == StepStatus::restored) ++restored;
    if (r.step.status == StepStatus::contact_not_converged) ++not_converged;
    if (r.step.redone > 0) ++redone;
    if (r.step.motion_share < 1) ++cut;
    least_share = std::min(least_share, r.step.motion_share);
    energy_made += r.step.energy_made;
    if (1e-3 * step_ms.back() > config.visual_step) ++overruns;
  }

  // On the visual loop's thread; the others are done when the rows are written.
  void attachments(const World& world, const VisualRecord& r) {
    std::size_t at = 0;
    for (int b = 0; b < world.bodies(); ++b) {
      const Body body = world.body(b);
      if (body.model.attachments().empty()) continue;
      const std::vector<AttachmentForce> forces = body.system.attachmentForces();
      for (std::size_t k = 0; k < forces.size(); ++k, ++at) {
        if (at == attached.size()) attached.push_back({body.model.name(), body.model.attachments()[k].name});
        attachment_rows.push_back({r.time, at, forces[k]});
        if (r.step.failed()) {
          attachment_rows.back().force.force.setConstant(std::nan(""));
          continue;
        }
        attached[at].peak = std::max(attached[at].peak, forces[k].force.norm());
        attached[at].last = forces[k].force;
      }
    }
  }

  void writeAttachments() {
    if (attachment_rows.empty() || settings.tables == RunTables::none) return;
    CsvWriter csv(folder.stage("attachments.csv"), kAttachmentColumns);
    for (const AttachmentRow& row : attachment_rows) {
      csv.cell(row.time).cell(attached[row.attachment].body.c_str()).cell(attached[row.attachment].name.c_str());
      for (int k = 0; k < 3; ++k) csv.cell(row.force.force[k]);
      for (int k = 0; k < 3; ++k) csv.cell(row.force.moment[k]);
      csv.endRow();
    }
    csv.close();
  }

  double maxOf(const std::vector<double>& v) const { return v.empty() ? 0.0 : *std::max_element(v.begin(), v.end()); }

  static nlohmann::ordered_json spread(const std::vector<double>& us) {
    return {{"p50", us[0]}, {"p99", us[1]}, {"p99_9", us[3]}, {"max", us[2]}};
  }

  static nlohmann::ordered_json flagCounts(const TickCounters& counters) {
    nlohmann::ordered_json flags;
    for (std::size_t k = 0; k < kTickFlagCount; ++k) {
      flags[toString(static_cast<TickFlag>(k))] = counters[static_cast<TickFlag>(k)];
    }
    return flags;
  }

  // Of the ticks in which the device could not give the force asked for.
  static double shareOf(const RunOutcome& outcome, TickFlag flag) {
    const auto flagged = static_cast<double>(outcome.counters[flag]);
    return outcome.ticks > 0 ? flagged / static_cast<double>(outcome.ticks) : 0.0;
  }

  static std::string endedBy(const RunOutcome& outcome) {
    if (!outcome.failure.empty()) return "failure";
    return outcome.ended_by.empty() ? "duration" : outcome.ended_by;
  }
  static double missedShare(const RunOutcome& outcome) {
    const auto missed = static_cast<double>(outcome.missed);
    return outcome.missed > 0 ? missed / (static_cast<double>(outcome.ticks) + missed) : 0.0;
  }
  // Longest time from one tick to the next [s].
  double longestGap(const RunOutcome& outcome) const {
    return static_cast<double>(outcome.most_missed + 1) * config.haptic_step;
  }

  double rmsOf(double squares) const {
    return std::sqrt(squares / static_cast<double>(std::max<std::int64_t>(1, ticks)));
  }

  nlohmann::ordered_json hardware(const Device& device) const {
    const DeviceReport r = device.report();
    const DeviceLimits& l = config.device.limits;
    nlohmann::ordered_json j;
    j["name"] = r.name;
    for (const auto& [key, value] : r.facts) j["says"][key] = value;
    j["limits_in_scene"] = {{"peak_force_N", l.peak_force},
                            {"continuous_force_N", l.continuous_force},
                            {"peak_torque_Nm", l.peak_torque},
                            {"stiffness_N_m", l.stiffness},
                            {"damping_Ns_m", l.damping},
                            {"rotational_stiffness_Nm_rad", l.rotational_stiffness},
                            {"workspace_radius_m", l.workspace_radius}};
    const LinkParameters& k = config.link;
    j["link"] = {{"stiffness_N_m", k.stiffness},
                 {"damping_Ns_m", k.damping},
                 {"rotational_stiffness_Nm_rad", k.rotational_stiffness},
                 {"rotational_damping_Nms_rad", k.rotational_damping}};
    j["heat"] = {{"largest", r.heat}, {"limited_s", r.hot_s}};
    j["losses"] = r.losses;
    j["lost_s"] = r.lost_s;
    j["jumps"] = r.jumps;
    j["clutches"] = r.clutches;
    j["indexed_m"] = r.indexed_m;
    j["notes"] = config.device.notes;
    for (const std::string& note : r.notes) j["notes"].push_back(note);
    return j;
  }

  void addDeviceRows(const Device& device, const RunOutcome& outcome) {
    if (config.device.limits.peak_torque <= 0.0 && lost_torque_peak > 0.0) {
      add("torque that the device cannot give: peak, RMS",
          plain({1e3 * lost_torque_peak, 1e3 * rmsOf(lost_torque_squares)}), "mN m");
    }
    if (!device.isReal()) return;
    const DeviceReport r = device.report();
    add("device", r.name, "");
    add("heat of its motors, most; force held down by it", fmt::format("{:.0f} %, {:.3g}", 100 * r.heat, r.hot_s), "s");
    if (const double share = shareOf(outcome, TickFlag::device_limited); share > 0) {
      add("force held below its peak: return, clutch, heat", fmt::format("{:.1f}", 100 * std::min(1.0, share)),
          "% of ticks");
    }
    if (r.losses > 0) add("device lost", fmt::format("{} times, {:.3g}", r.losses, r.lost_s), "s", true);
    if (r.jumps > 0) add("jumps of its position", fmt::format("{}", r.jumps), "", true);
    if (r.clutches > 0) add("clutch pressed", fmt::format("{}", r.clutches), "times");
    if (r.indexed_m > 0) add("moved on at the border of the workspace", fmt::format("{:.3g}", r.indexed_m), "m");
    for (const std::string& note : r.notes) add("device says", note, "", true);
  }

  nlohmann::ordered_json summary(const BuiltScene& scene, const RunOutcome& outcome) const {
    nlohmann::ordered_json j;
    j["scene"] = config.name;
    j["method"] = toString(config.method);
    j["handle"] = config.tool.handle;
    j["device"] = toString(config.device.kind);
    j["aim"] = toString(config.aim);
    j["derivative"] = toString(config.derivative);
    j["latency"] = config.latency;
    j["jitter"] = config.jitter;
    j["realtime"] = outcome.realtime;
    j["duration_s"] = config.duration;
    j["end_s"] = outcome.end_time;
    j["interrupted"] = outcome.stopped && outcome.failure.empty();
    j["ended_by"] = endedBy(outcome);
    if (!outcome.failure.empty()) j["failure"] = outcome.failure;
    j["mesh"] = {
        {"tetrahedra", scene.tetrahedra}, {"nodes", scene.nodes}, {"surface_triangles", scene.surface_triangles}};
    j["visual"] = {{"step_s", config.visual_step},
                   {"steps", step_ms.size()},
                   {"median_ms", percentile(step_ms, 0.5)},
                   {"p95_ms", percentile(step_ms, 0.95)},
                   {"p99_9_ms", percentile(step_ms, 0.999)},
                   {"max_ms", maxOf(step_ms)},
                   {"median_contact_ms", percentile(step_ms_contact, 0.5)},
                   {"overruns", overruns},
                   {"restored", restored},
                   {"not_converged", not_converged},
                   {"redone", redone},
                   {"cut", cut},
                   {"least_motion_share", least_share},
                   {"energy_made_J", energy_made}};
    if (const auto& chosen = outcome.auto_step) {
      j["visual"]["auto"] = {{"warm_up_p99_ms", 1e3 * chosen->cost_s}, {"share", kAutoShare}, {"holds", chosen->holds}};
    }
    j["haptic"] = {{"rate_hz", 1.0 / config.haptic_step},
                   {"ticks", outcome.ticks},
                   {"tick_us", spread(outcome.tick_us)},
                   {"missed", outcome.missed},
                   {"clamped_share", shareOf(outcome, TickFlag::force_clamped)},
                   {"stale_share", shareOf(outcome, TickFlag::model_stale)}};
    if (outcome.realtime) {
      j["haptic"]["wake_us"] = spread(outcome.wake_us);
      j["visual"]["response_us"] = spread(outcome.response_us);
      const ModelTraffic& models = outcome.models;
      j["haptic"]["models"] = {{"made", models.made},
                               {"used", models.account.used},
                               {"refused", models.account.refused},
                               {"late", models.overwritten + models.account.overtaken},
                               {"under_way", models.underWay()}};
      j["haptic"]["missed_share"] = missedShare(outcome);
      j["haptic"]["longest_gap_s"] = longestGap(outcome);
      j["haptic"]["gaps"] = outcome.counters[TickFlag::gap];
      j["haptic"]["dropped_rows"] = outcome.dropped_rows;
      j["haptic"]["priority_note"] = outcome.realtime_note;
    }
    j["haptic"]["flags"] = flagCounts(outcome.counters);
    j["linearization"] = {{"median_ms", percentile(linearization_ms, 0.5)},
                          {"median_contact_ms", percentile(linearization_ms_contact, 0.5)}};
    j["contact"] = {{"max_active", static_cast<int>(maxOf(active))},
                    {"max_contacts", static_cast<int>(maxOf(contacts))},
                    {"max_penetration_m", 1e-3 * maxOf(penetration_mm)},
                    {"max_residual", max_residual}};
    j["force"] = {{"peak_N", peak_force},
                  {"rms_N", ticks > 0 ? std::sqrt(force_squares / static_cast<double>(ticks)) : 0.0},
                  {"delivered_J", outcome.delivered_energy}};
    if (config.device.limits.peak_torque <= 0.0) {
      j["lost_torque"] = {{"peak_Nm", lost_torque_peak}, {"rms_Nm", rmsOf(lost_torque_squares)}};
    }
    if (scene.device->isReal()) j["hardware"] = hardware(*scene.device);
    for (const Attached& a : attached) {
      j["attachments"].push_back(
          {{"body", a.body}, {"name", a.name}, {"peak_N", a.peak}, {"last_N", {a.last.x(), a.last.y(), a.last.z()}}});
    }
    const SwitchAccount& account = outcome.switches;
    if (account.dissipated() > 0) {
      j["live"] = {{"energy_rises_J", account.rises()},
                   {"energy_falls_J", account.falls()},
                   {"largest_rise_J", account.largestRise()},
                   {"dissipated_J", account.dissipated()}};
      for (const auto& [part, ms] : reduction_ms_contact) {
        j["live"]["parts_median_contact_ms"][part] = percentile(ms, 0.5);
      }
    }
    return j;
  }

  void closeTables() {
    reserve.release();
    for (TableWriter* table : tables()) attempt([table] { table->close(); });
    if (!attempt([this] { writeAttachments(); })) folder.unstage("attachments.csv");
  }

  void add(const std::string& what, const std::string& value, const std::string& unit, bool is_bad = false) {
    if (is_bad) bad.push_back(rows.size());
    rows.push_back({what, value, unit});
  }

  void fillRows(const BuiltScene& scene, const RunOutcome& outcome) {
    if (outcome.stopped || !outcome.failure.empty()) {
      const std::string why = outcome.failure.empty() ? endedBy(outcome) : outcome.failure;
      add("ended early: " + why, fmt::format("at {:.3g}", outcome.end_time), "s", true);
    }
    add("tetrahedra, surface triangles", fmt::format("{}, {}", scene.tetrahedra, scene.surface_triangles), "");
    add("visual step: median, 95 %, longest",
        plain({percentile(step_ms, 0.5), percentile(step_ms, 0.95), maxOf(step_ms)}), "ms");
    if (const auto& chosen = outcome.auto_step) {
      add("  chosen step; 99 % in the warm-up", plain({1e3 * chosen->step, 1e3 * chosen->cost_s}), "ms",
          !chosen->holds);
    }
    add("  of it linearization, median", plain({percentile(linearization_ms, 0.5)}), "ms");
    add("haptic tick: median, 99 %, longest", plain({outcome.tick_us[0], outcome.tick_us[1], outcome.tick_us[2]}),
        "us");
    addTimeRows(outcome);
    addSafetyRows(outcome);
    addUnusualRow(outcome);
    add("contacts carrying force, most", fmt::format("{:.0f}", maxOf(active)), "");
    add("deepest penetration", plain({maxOf(penetration_mm)}), "mm");
    add("force on the hand: peak, RMS",
        plain({peak_force, std::sqrt(force_squares / static_cast<double>(std::max<std::int64_t>(1, ticks)))}), "N");
    if (const double share = shareOf(outcome, TickFlag::force_clamped); share > kMuchClamped) {
      add(fmt::format("force held at the device's {:g} N", config.device.limits.peak_force),
          fmt::format("{:.1f}", 100 * share), "% of ticks");
    }
    addDeviceRows(*scene.device, outcome);
    for (const Attached& a : attached) add(fmt::format("{} held by {}: peak", a.body, a.name), plain({a.peak}), "N");
  }

  // What the safety stage has done.
  void addSafetyRows(const RunOutcome& outcome) {
    const auto seconds = [&](TickFlag flag) {
      return fmt::format("{:.2f}", config.haptic_step * static_cast<double>(outcome.counters[flag]));
    };
    if (const std::uint64_t swings = outcome.counters[TickFlag::oscillation]; swings > 0) {
      add("force swung by itself and was made smaller",
          fmt::format("{} times, for {}", swings, seconds(TickFlag::calmed)), "s", true);
    }
    const auto addTime = [&](TickFlag flag, const std::string& what, bool is_bad) {
      if (outcome.counters[flag] > 0) add(what, seconds(flag), "s", is_bad);
    };
    addTime(TickFlag::device_lost, "device lost, frozen or absurd, force away", true);
    addTime(TickFlag::button_released, "dead-man button not pressed, force away", false);
    addTime(TickFlag::outside_workspace, "out of the workspace, force away", false);
    addTime(TickFlag::gate_closed, "start gate closed, force away", false);
  }

  // One row, and none for a run in which nothing of it came up.
  void addUnusualRow(const RunOutcome& outcome) {
    std::vector<std::string> parts;
    const auto count = [&](TickFlag flag, const char* text) {
      if (outcome.counters[flag] > 0) parts.push_back(fmt::format("{} {}", text, outcome.counters[flag]));
    };
    count(TickFlag::model_rejected, "models refused");
    count(TickFlag::model_damped, "models slowed");
    count(TickFlag::proxy_limited, "proxy at its limit");
    count(TickFlag::slew_limited, "change of force limited");
    if (energy_made > kMuchMade) parts.push_back(fmt::format("steps made {:.3g} mJ", 1e3 * energy_made));
    if (!parts.empty()) add("out of the ordinary, ticks", fmt::format("{}", fmt::join(parts, ", ")), "", true);
  }

  // How well the run kept its time.
  void addTimeRows(const RunOutcome& outcome) {
    const double stale = shareOf(outcome, TickFlag::model_stale);
    if (outcome.realtime || stale > 0) {
      add("model too old, force faded", fmt::format("{:.1f}", 100 * stale), "% of ticks", stale > kMuchStale);
    }
    if (!outcome.realtime) return;
    const double late = static_cast<double>(overruns) / static_cast<double>(std::max<std::size_t>(1, step_ms.size()));
    add(fmt::format("visual steps longer than {:g} ms", 1e3 * config.visual_step),
        fmt::format("{} of {}", overruns, step_ms.size()), "", late > kMuchOverrun);
    add("wake-up latency: median, 99 %, longest", plain({outcome.wake_us[0], outcome.wake_us[1], outcome.wake_us[2]}),
        "us");
    add("haptic ticks missed", fmt::format("{} of {}", outcome.missed, outcome.ticks + outcome.missed), "",
        missedShare(outcome) > kMuchMissed);
    if (const std::uint64_t gaps = outcome.counters[TickFlag::gap]; gaps > 0) {
      add("gaps, after which the force began anew", fmt::format("{}, longest {:.2f}", gaps, longestGap(outcome)), "s",
          true);
    }
    if (outcome.dropped_rows > 0) add("rows lost in recording", fmt::format("{}", outcome.dropped_rows), "", true);
  }

  void writePictures(const RunPictures& pictures) {
    const auto write = [this](const std::string& name, const std::vector<unsigned char>& png) {
      if (!attempt([&] { writePng(name, png); })) folder.unstage(name);
    };
    for (std::size_t k = 0; k < pictures.images.size(); ++k) {
      write(fmt::format("picture-{}.png", k + 1), pictures.images[k].png);
    }
    if (!pictures.sheet.empty()) write("pictures.png", pictures.sheet);
  }

  // The summary first, as it is short: where the disk is full, the report may not fit.
  void writeSummaryAndReport(const BuiltScene& scene, RunOutcome outcome, const Comparison* comparison,
                             const RunPictures& pictures) {
    const auto report_file = settings.page ? folder.stage("report.html") : std::filesystem::path();
    const auto summary_file = folder.stage("summary.json");
    if (outcome.failure.empty()) outcome.failure = failure;
    if (!attempt([&] { writeJson(summary_file, summary(scene, outcome)); })) dropOutput("summary.json");
    if (!settings.page) return;
    if (!attempt([&] { writeReport(report_file, report(comparison, pictures)); })) dropOutput("report.html");
  }

  // That of an earlier run would look like this one's.
  void dropOutput(const std::string& name) {
    folder.unstage(name);
    std::error_code ignored;
    std::filesystem::remove(folder.path() / name, ignored);
  }

  Report report(const Comparison* other, const RunPictures& pictures) const {
    Report page;
    page.title = fmt::format("Palpate: {}", config.name);
    page.subtitle = fmt::format("{} held by {}, method {}, visual step {} ms, latency {}, {} s", config.tool.name,
                                config.tool.handle, toString(config.method), 1e3 * config.visual_step, config.latency,
                                config.duration);
    page.tables.push_back({"This run", {"", "", ""}, rows, "", bad});
    page.images = pictures.images;
    page.images_note = pictures.note;
    page.plots.push_back(vectorPlot("Force on the hand", "Force, N", plot_time, plot_sent, 0, "time",
                                    "What the device renders, after the safety stage; world frame, z up."));
    if (other != nullptr) page.plots.push_back(comparisonPlot(*other));
    page.plots.push_back(vectorPlot("Torque on the hand", "Torque, N m", plot_time, plot_sent, 3, "time", ""));
    page.plots.push_back(positionPlot());
    addStepPlots(page.plots);
    page.footer =
        "Written by palpate run. The numbers behind the plots: haptic.csv, visual.csv, timing.csv, summary.json.";
    if (settings.tables == RunTables::hdf5) {
      page.footer =
          "Written by palpate run. The numbers behind the plots: haptic.h5, visual.h5, timing.csv, summary.json.";
    }
    return page;
  }

  Plot positionPlot() const {
    Plot where;
    where.title = "Height and travel";
    where.y_label = "Position, m";
    where.x = plot_time;
    where.group = "time";
    where.note = "Device (solid) and the proxy of the handle (dashed); they part where a force acts.";
    const std::array<const char*, 3> names{"x", "y", "z"};
    for (int k = 0; k < 3; ++k) {
      Series device{std::string("device ") + names[k], {}, std::to_string(k + 1)};
      Series proxy{std::string("proxy ") + names[k], {}, std::to_string(k + 1)};
      proxy.dashed = true;
      for (std::size_t i = 0; i < plot_time.size(); ++i) {
        device.values.push_back(plot_device[i][k]);
        proxy.values.push_back(plot_proxy[i][k]);
      }
      where.series.push_back(std::move(device));
      where.series.push_back(std::move(proxy));
    }
    return where;
  }

  void addStepPlots(std::vector<Plot>& plots) const {
    const auto add = [&](const std::string& title, const std::string& label, std::vector<Series> series,
                         const std::string& note) {
      Plot p;
      p.title = title;
      p.y_label = label;
      p.x = step_time;
      p.series = std::move(series);
      p.group = "time";
      p.half_width = true;
      p.note = note;
      plots.push_back(std::move(p));
    };
    add("Contacts", "Contacts", {{"after reduction", contacts}, {"carrying force", active}, {"sliding", sliding}}, "");
    add("Deepest penetration", "Penetration, mm", {{"penetration", penetration_mm}},
        "Of any surface vertex at the end of a visual step.");
    add("Energy of the bodies", "Energy, J", {{"kinetic", kinetic}, {"elastic", elastic}}, "");
    add("Cost of a visual step", "Time, ms", {{"whole step", step_ms}, {"linearization", linearization_ms}}, "");
  }

  void writePng(const std::string& name, const std::vector<unsigned char>& png) {
    writeWhole(folder.stage(name), {reinterpret_cast<const char*>(png.data()), png.size()});
  }

  // Those of an earlier run with more pictures would look like this run's.
  void removeOldPictures(const RunPictures& pictures) const {
    std::error_code ignored;
    for (std::size_t k = pictures.images.size() + 1; k <= kMostPictures; ++k) {
      std::filesystem::remove(folder.path() / fmt::format("picture-{}.png", k), ignored);
    }
    if (pictures.sheet.empty()) std::filesystem::remove(folder.path() / "pictures.png", ignored);
  }

  // Those of an earlier run that kept its rows in another form.
  void removeOldTables() const {
    std::error_code ignored;
    for (const char* name : {"haptic", "visual"}) {
      if (settings.tables != RunTables::csv)
        std::filesystem::remove(folder.path() / fmt::format("{}.csv", name), ignored);
      if (settings.tables != RunTables::hdf5)
        std::filesystem::remove(folder.path() / fmt::format("{}.h5", name), ignored);
    }
  }

  Plot comparisonPlot(const Comparison& other) const {
    Plot plot;
    plot.title = fmt::format("Size of the force: {} beside {}", toString(config.method), other.method);
    plot.y_label = "Force, N";
    plot.x = plot_time;
    plot.group = "time";
    plot.note = fmt::format(
        "The same motion of the device, both before the safety stage. Where the hand moves through free air, what {} "
        "adds is "
        "drag that is not there.",
        other.method);
    Series own{toString(config.method), {}};
    Series theirs{other.method, {}};
    std::size_t j = 0;
    for (std::size_t i = 0; i < plot_time.size(); ++i) {
      own.values.push_back(plot_raw[i].head<3>().norm());
      while (j + 1 < other.time.size() && other.time[j] < plot_time[i] - 1e-9) ++j;
      theirs.values.push_back(other.raw.empty() ? 0.0 : other.raw[j].head<3>().norm());
    }
    plot.series = {std::move(theirs), std::move(own)};
    return plot;
  }

  struct Attached {
    std::string body, name;
    double peak = 0;           // [N]
    Vec3 last = Vec3::Zero();  // [N]
  };
  struct AttachmentRow {
    double time;
    std::size_t attachment;  // index of attached
    AttachmentForce force;
  };

  SceneConfig config;
  RunFilesSettings settings;
  OutputFolder folder;
  SpaceReserve reserve;
  std::string failure;
  std::unique_ptr<TableWriter> haptic, motion, visual, timing;
  std::int64_t ticks = 0;
  std::int64_t plot_stride = 1;
  double peak_force = 0, force_squares = 0, max_residual = 0;
  double lost_torque_peak = 0, lost_torque_squares = 0;
  int restored = 0, not_converged = 0, overruns = 0, redone = 0, cut = 0;
  double least_share = 1, energy_made = 0;
  std::vector<double> plot_time;
  std::vector<Vec6> plot_raw, plot_sent;
  std::vector<Vec3> plot_device, plot_proxy;
  std::vector<double> step_time, step_ms, step_ms_contact, linearization_ms, linearization_ms_contact, active, contacts,
      sliding, penetration_mm, kinetic, elastic;
  std::map<std::string, std::vector<double>> reduction_ms_contact;  // by part
  std::vector<std::vector<std::string>> rows;
  std::vector<std::size_t> bad;  // rows
  std::vector<Attached> attached;
  std::vector<AttachmentRow> attachment_rows;
};

RunFiles::RunFiles(const std::filesystem::path& folder, const SceneConfig& config, const RunFilesSettings& settings)
    : impl_(std::make_unique<Impl>(folder, config, settings)) {
  constexpr double kPlotRows = 40000;
  impl_->plot_stride =
      std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil(config.duration / config.haptic_step / kPlotRows)));
}

RunFiles::~RunFiles() = default;

const std::vector<std::string>& runTablesNames() {
  static const std::vector<std::string> names{"csv", "hdf5", "none"};
  return names;
}

std::filesystem::path RunFiles::stage(const std::string& name) { return impl_->folder.stage(name); }

RunSink RunFiles::sink() {
  RunSink s;
  s.tick = [this](const TickRecord& r) { impl_->tick(r); };
  s.visual = [this](const VisualRecord& r) { impl_->step(r); };
  s.stepped = [this](const World& world, const VisualRecord& r) { impl_->attachments(world, r); };
  return s;
}

const std::string& RunFiles::failure() const { return impl_->failure; }

void RunFiles::finish(const BuiltScene& scene, const RunOutcome& outcome, const Comparison* comparison,
                      const RunPictures& pictures) {
  Impl& i = *impl_;
  i.closeTables();
  i.fillRows(scene, outcome);
  i.writePictures(pictures);
  i.writeSummaryAndReport(scene, outcome, comparison, pictures);
  i.folder.commit();
  i.removeOldPictures(pictures);
  i.removeOldTables();
}

std::string RunFiles::table(bool color) const {
  std::string out;
  for (std::size_t r = 0; r < impl_->rows.size(); ++r) {
    const auto& row = impl_->rows[r];
    const bool bad = std::find(impl_->bad.begin(), impl_->bad.end(), r) != impl_->bad.end();
    const std::string line = fmt::format("{} {:<42}{:>22} {}", bad ? '!' : ' ', row[0], row[1], row[2]);
    out += bad && color ? fmt::format("\x1b[31m{}\x1b[0m\n", line) : line + "\n";
  }
  return out;
}

}  // namespace palpate
