#include "palpate/devices/motion_recording.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <ostream>
#include <sstream>

#include "palpate/common/error.h"
#include "palpate/devices/path.h"

namespace palpate {
namespace {

constexpr std::size_t kRequired = 8;
constexpr std::size_t kTwistEnd = 14;
constexpr std::array<std::string_view, 15> kColumns{"time_s", "x_m",      "y_m",      "z_m",      "qw",
                                                    "qx",     "qy",       "qz",       "vx_m_s",   "vy_m_s",
                                                    "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s", "buttons"};
constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
using Row = std::array<double, kColumns.size()>;

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Takes the next piece up to `separator` off the front of `rest`.
std::string_view takeUntil(std::string_view& rest, char separator) {
  const std::size_t end = std::min(rest.find(separator), rest.size());
  const std::string_view piece = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return piece;
}

/// Text from outside as it may stand in an error message: short and printable.
std::string quoted(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, 40)) result += c >= ' ' && c <= '~' ? c : '?';
  return result + (text.size() > 40 ? "...'" : "'");
}

class Parser {
 public:
  Parser(std::string_view text, const std::string& name) : rest_(text), name_(name) {}

  MotionRecording parse() {
    const std::optional<std::string_view> header = nextLine();
    if (!header) fail("is empty; expected a header line with time_s,x_m,y_m,z_m,qw,qx,qy,qz");
    readHeader(*header);
    MotionRecording recording;
    recording.has_twist = has_[kRequired];
    while (const std::optional<std::string_view> line = nextLine()) {
      if (recording.samples.size() == kMaxMotionRows)
        fail("has more than " + std::to_string(kMaxMotionRows) + " rows; cut it into shorter recordings");
      recording.samples.push_back(toSample(readRow(*line)));
      checkTime(recording.samples);
    }
    if (recording.samples.empty()) fail("has no rows");
    return recording;
  }

 private:
  [[noreturn]] void fail(const std::string& cause) const {
    throw InputError(name_, line_ == 0 ? "" : "line " + std::to_string(line_), cause);
  }

  /// Next line with something on it.
  std::optional<std::string_view> nextLine() {
    while (!rest_.empty()) {
      ++line_;
      const std::string_view line = trimmed(takeUntil(rest_, '\n'));
      if (!line.empty() && line.front() != '#') return line;
    }
    return std::nullopt;
  }

  void readHeader(std::string_view line) {
    if (line.substr(0, 3) == "\xEF\xBB\xBF") line.remove_prefix(3);  // byte order mark of spreadsheets
    for (bool more = true; more;) {
      more = line.find(',') != std::string_view::npos;
      const std::string_view title = trimmed(takeUntil(line, ','));
      const auto known = std::find(kColumns.begin(), kColumns.end(), title);
      if (known == kColumns.end()) fail("unknown column " + quoted(title));
      const auto column = static_cast<std::size_t>(known - kColumns.begin());
      if (has_[column]) fail("column " + quoted(title) + " is there twice");
      has_[column] = true;
      order_.push_back(column);
    }
    for (std::size_t column = 0; column < kTwistEnd; ++column) {
      const bool needed =
          column < kRequired || std::any_of(&has_[kRequired], &has_[kTwistEnd], [](bool b) { return b; });
      if (needed && !has_[column]) fail("column " + quoted(kColumns[column]) + " is missing");
    }
  }

  Row readRow(std::string_view line) const {
    Row row{};
    for (std::size_t k = 0; k < order_.size(); ++k) {
      const bool last = line.find(',') == std::string_view::npos;
      const std::string_view value = trimmed(takeUntil(line, ','));
      row[order_[k]] = number(value, kColumns[order_[k]]);
      if (last != (k + 1 == order_.size()))
        fail("has " + std::string(last ? "fewer" : "more") + " values than the header has columns");
    }
    return row;
  }

  double number(std::string_view text, std::string_view column) const {
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
      fail(std::string(column) + " must be a finite number, not " + quoted(text));
    return value;
  }

  MotionSample toSample(const Row& row) const {
    MotionSample sample;
    sample.time = row[0];
    sample.state.pose.position << row[1], row[2], row[3];
    Quat& rotation = sample.state.pose.rotation;
    rotation = Quat(row[4], row[5], row[6], row[7]);
    const double norm = rotation.norm();
    if (!(norm > 0.9 && norm < 1.1)) fail("quaternion qw,qx,qy,qz must have norm 1");
    // One written with few digits is made a unit one; an exact one keeps its bits.
    if (std::abs(norm - 1.0) > 1e-12) rotation.normalize();
    sample.state.twist << row[8], row[9], row[10], row[11], row[12], row[13];
    if (!(row[14] >= 0.0 && row[14] <= 4294967295.0) || row[14] != std::floor(row[14]))
      fail("buttons must be a whole number from 0 to 4294967295");
    sample.state.buttons = static_cast<std::uint32_t>(row[14]);
    return sample;
  }

  void checkTime(const std::vector<MotionSample>& samples) const {
    const std::size_t n = samples.size();
    if (n > 1 && !(samples[n - 1].time > samples[n - 2].time + kSameInstant))
      fail("time_s must increase from row to row");
  }

  std::string_view rest_;
  const std::string& name_;
  std::size_t line_ = 0;
  std::array<bool, kColumns.size()> has_{};
  std::vector<std::size_t> order_;  // column of the k-th value of a row
};

}  // namespace

MotionRecording parseMotion(std::string_view text, const std::string& name) { return Parser(text, name).parse(); }

MotionRecording readMotion(const std::filesystem::path& file) {
  const std::string name = file.string();
  std::error_code error;
  if (!std::filesystem::exists(file, error)) throw InputError(name, "", "no such file");
  if (!std::filesystem::is_regular_file(file, error)) throw InputError(name, "", "is not a file");
  const std::uintmax_t bytes = std::filesystem::file_size(file, error);
  if (error || bytes > kMaxBytes) throw InputError(name, "", "is larger than 1 GiB; cut it into shorter recordings");
  std::ifstream in(file, std::ios::binary);
  std::string text(static_cast<std::size_t>(bytes), '\0');
  if (!in || !in.read(text.data(), static_cast<std::streamsize>(text.size())))
    throw InputError(name, "", "cannot be read");
  return parseMotion(text, name);
}

void writeMotion(std::ostream& out, const MotionRecording& recording) {
  for (std::size_t k = 0; k < kColumns.size(); ++k) out << (k > 0 ? "," : "") << kColumns[k];
  out << '\n';
  for (const MotionSample& sample : recording.samples) {
    const Vec3& p = sample.state.pose.position;
    const Quat& q = sample.state.pose.rotation;
    const Vec6& u = sample.state.twist;
    for (const double value :
         {sample.time, p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z(), u[0], u[1], u[2], u[3], u[4], u[5]}) {
      std::array<char, 32> buffer;
      const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
      out.write(buffer.data(), end - buffer.data());
      out << ',';
    }
    out << sample.state.buttons << '\n';
  }
}

}  // namespace palpate
