#pragma once

/// @file
/// Palpate whole: scenes, their simulation, handle models, runs. Library palpate::palpate.
///
///     palpate::Scene scene = palpate::Scene::load("cube.yaml");      // or parse(text), and set() any key
///     palpate::World world(scene);                                   // meshes, bodies at rest
///     palpate::VisualStep step = world.visualStep({world.start()});  // one step of 33 ms, and its handle model
///     palpate::HapticLoop loop(world.hapticSettings());
///     loop.start(world.start(), world.handle(), 0);
///     palpate::Tick tick = loop.tick({world.start()}, &step.model, 0);  // the force for a device: tick.sent
///     std::string saved = world.save();                              // ... world.restore(saved)
///
///     palpate::Run run(scene);                                       // all of it in virtual time, with any method
///     run.finish();
///
/// Units, frames and order as in haptics.h. Different objects may be used by different threads at once; one object by
/// one thread at a time. Building a scene that takes longer than a second says so on standard error.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/api.h"
#include "palpate/haptics.h"

PALPATE_BEGIN_API

/// A scene as its YAML file states it (docs/scene.md). A value: copies are independent.
class PALPATE_EXPORT Scene {
 public:
  /// @throws InputError with the key of what is wrong
  static Scene load(const std::string& file);
  /// @param text    YAML
  /// @param name    stands for the file in errors
  /// @param folder  to which files that it names are relative
  static Scene parse(std::string_view text, const std::string& name = "scene", const std::string& folder = ".");
  Scene(const Scene&);
  Scene(Scene&&) noexcept;
  Scene& operator=(const Scene&);
  Scene& operator=(Scene&&) noexcept;
  ~Scene();

  /// Sets a value by its key, e.g. "tool.material.youngs_modulus", "bodies[0].pose.position"; keys and last entries of
  /// lists that are missing are made. Comments are lost.
  /// @param value  YAML, e.g. "2.0e4" or "[0, 0, 0.1]"
  /// @throws InputError; the scene is then as it was
  Scene& set(const std::string& key, const std::string& value);
  Scene& set(const std::string& key, double value);

  std::string text() const;  ///< YAML that reads as this scene
  const std::string& name() const noexcept;
  std::string method() const;          ///< live, hsl, hsl-exact or vc
  double duration() const noexcept;    ///< of a run [s]
  double visualStep() const noexcept;  ///< [s]
  double hapticStep() const noexcept;  ///< [s]
  int latency() const noexcept;        ///< visual steps until a model reaches the haptic loop

 private:
  friend class World;
  friend class Run;
  struct PALPATE_LOCAL Impl;
  explicit Scene(std::shared_ptr<const Impl> impl);
  std::shared_ptr<const Impl> impl_;
};

/// What a step did.
struct StepReport {
  bool failed = false;     ///< it could not be solved: the last good state, at rest
  bool sound = true;       ///< it went to its end, with contact as it should be
  bool converged = true;   ///< contact, to the solver's tolerance
  int contacts_found = 0;  ///< within reach, before reduction
  int contacts = 0, active = 0, sticking = 0, sliding = 0;
  int solver_iterations = 0;
  double solver_residual = 0;                     ///< [m/s]
  double penetration = 0;                         ///< deepest surface point in another solid [m]
  double motion_share = 1;                        ///< least share of a body's motion that was made
  int redone = 0;                                 ///< shorter steps in which it was done again
  double kinetic_energy = 0, elastic_energy = 0;  ///< at the end [J]
  double energy_made = 0;                         ///< by the step itself [J]
  double seconds = 0;                             ///< of computing
};

struct VisualStep {
  double time = 0;  ///< at which it began [s]
  StepReport report;
  HandleModel model;
};

/// How the derivatives of a handle model are taken (docs/linearization.md).
struct Linearization {
  bool exact = false;  ///< whole contact matrix, `hsl-exact`; else its diagonal, `hsl`
  bool full = false;   ///< rotations of elements live as well; else frozen
};

/// Symmetric matrix of 3x3 blocks, its upper triangle by block rows: what scipy.sparse calls BSR. Blocks are by rows.
struct BlockMatrix {
  int rows = 0;               ///< block rows
  std::vector<int> begin;     ///< [rows + 1] first block of each block row
  std::vector<int> column;    ///< block column of each block, at first the diagonal's
  std::vector<double> value;  ///< nine a block
};

/// A contact of the last step.
struct Contact {
  int first = -1, second = -1;  ///< bodies; -1: fixed geometry
  bool glued = false;           ///< not a contact: two places that are glued
  Vector3 position{};           ///< [m]
  Vector3 normal{};             ///< unit, from second to first
  double gap = 0;               ///< at the start of the step [m]
  double friction = 0;          ///< coefficient
  Vector3 force{};              ///< on the first body, mean over the step, world [N]
  bool active = false, sliding = false;
};

/// Contacts of the last step that act on one another, and their compliance matrix W = J A^-1 J^T.
struct ContactIsland {
  std::span<const int> contacts;  ///< places in World::contacts()
  std::span<const double> w;      ///< symmetric, (3n, 3n), rows normal, first and second tangent of each [1/kg]
};

/// A scene that is simulated, without a haptic loop. Spans are views: valid until the next call that is not const.
class PALPATE_EXPORT World {
 public:
  /// Builds bodies and meshes, and lets them settle.
  /// @param threads  that work on a step, the calling one included; results do not depend on it
  /// @throws InputError for what only a mesh can tell
  explicit World(const Scene& scene, int threads = 1);
  ~World();
  World(World&&) noexcept;
  World& operator=(World&&) noexcept;

  // --- steps
  /// One step of the dynamics, the handle pulled towards the device.
  /// @param step  its length [s]; 0: the scene's
  StepReport step(const DeviceState& device, double step = 0);
  /// The same, and the handle model of it by the scene's method (`hsl` for `live`): what a run does. If the step fails
  /// the model before stays.
  VisualStep visualStep(const DeviceState& device, double step = 0);
  /// Model of the present state, which stays as it is: for the start. @throws RunError if the step that it takes fails
  HandleModel modelAtRest();
  /// Handle model of the last step(), in one go: the whole step must have been taken, StepReport::redone 0.
  /// @throws RunError without such a step
  HandleModel linearize(const Linearization& how = {}) const;
  /// Wrench of the tool on the handle at the end of the last step [N; N m].
  Vector6 couplingWrench() const;

  double time() const noexcept;  ///< that all steps took together [s]
  Pose start() const noexcept;   ///< first pose of the device
  Pose handle() const noexcept;  ///< pose of the handle
  Vector6 handleTwist() const noexcept;
  /// Gives the handle a pose and a twist, and its nodes with it.
  void setHandle(const Pose& pose, const Vector6& twist);
  /// For a HapticLoop of one's own; `linearized` for method `live`, which only a Run has.
  HapticSettings hapticSettings() const;

  // --- bodies: 0 is the tool
  int bodies() const noexcept;
  /// All that follow throw std::out_of_range for a body that is none.
  const std::string& bodyName(int body) const;
  bool isRigid(int body) const;
  std::span<const double> positions(int body) const;   ///< (n, 3), by rows: of the nodes [m]
  std::span<const double> velocities(int body) const;  ///< (n, 3) [m/s]
  std::span<const double> masses(int body) const;      ///< (n) [kg]
  std::span<const int> tetrahedra(int body) const;     ///< (m, 4): nodes
  std::span<const int> triangles(int body) const;      ///< (k, 3): vertices of the surface
  std::vector<double> surface(int body) const;         ///< (v, 3): places of the surface's vertices [m]
  std::vector<double> forces(int body) const;          ///< (n, 3): elastic forces on the nodes as they are [N]
  /// Nodes that move freely: neither on the handle nor held by the world. Rows of stiffness().
  std::span<const int> freeNodes(int body) const;
  /// K of the free nodes as they are, f(x + dx) = f - K dx at fixed element rotations [N/m].
  BlockMatrix stiffness(int body) const;
  /// Factor > 0 on all moduli of a body, against its scene.
  void setStiffnessScale(int body, double scale);
  /// Factor on all coefficients of friction.
  void setFrictionScale(double scale);

  // --- contacts of the last step
  std::vector<Contact> contacts() const;
  std::vector<ContactIsland> islands() const;

  // --- state
  /// All that a step hands to the next, as bytes.
  std::string save() const;
  /// Of a world built from the same scene: what follows is the same to the bit. @throws InputError
  void restore(std::string_view state);

 private:
  friend class Run;
  struct PALPATE_LOCAL Impl;
  explicit World(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct RunOptions {
  int threads = 1;                 ///< that work on a visual step
  std::shared_ptr<Device> device;  ///< in place of the scene's
  // In the order of time; each may be empty.
  std::function<void(const Tick&)> tick;
  std::function<void(const VisualStep&)> visual;
  std::function<bool()> stopped;  ///< asked all the time: the run is to end now
};

struct RunSummary {
  std::uint64_t ticks = 0;
  double end_time = 0;                                                           ///< [s]
  bool stopped = false;                                                          ///< it was told to end before its time
  std::string failure;                                                           ///< what made it end; empty: nothing
  double delivered_energy = 0;                                                   ///< net energy given to the hand [J]
  Percentiles tick_us{};                                                         ///< computing of a tick
  std::array<std::uint64_t, static_cast<std::size_t>(TickFlag::count)> flags{};  ///< ticks with each
  // Real time only.
  std::uint64_t missed = 0;  ///< haptic deadlines
  Percentiles wake_us{};     ///< deadline to wake-up
  std::string note;          ///< what the system refused
};

/// All of a run between two ticks. Cheap to copy; of this process only.
class PALPATE_EXPORT RunState {
 public:
  RunState();  ///< none
  RunState(const RunState&);
  RunState& operator=(const RunState&);
  ~RunState();

 private:
  friend class Run;
  struct PALPATE_LOCAL Impl;
  std::shared_ptr<const Impl> impl_;
};

/// A scene with its haptic loop, its device and its method, in virtual time: the same to the bit every time.
class PALPATE_EXPORT Run {
 public:
  /// @throws InputError, and RunError if a first step fails
  explicit Run(const Scene& scene, RunOptions options = {});
  ~Run();
  Run(Run&&) noexcept;
  Run& operator=(Run&&) noexcept;

  std::int64_t ticks() const noexcept;  ///< of the whole run
  std::int64_t next() const noexcept;   ///< tick to come; it is at next() * Scene::hapticStep()
  /// Runs ticks, with the visual steps that fall due. @return whether there are any left
  bool advance(std::int64_t ticks = 1);
  /// Runs to the end.
  RunSummary finish();
  RunSummary summary() const;
  const World& world() const noexcept;

  RunState save() const;
  /// Of a run of the same scene: what follows is the same to the bit. @throws InputError
  void restore(const RunState& state);

  /// A whole run in real time, each loop on a thread of its own; `tick` and `visual` come later, on the caller's.
  /// @throws RunError for a device that is not there
  static RunSummary realtime(const Scene& scene, RunOptions options = {});

 private:
  struct PALPATE_LOCAL Impl;
  std::unique_ptr<Impl> impl_;
};

PALPATE_END_API
