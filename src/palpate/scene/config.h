#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "palpate/contact/contact_settings.h"
#include "palpate/devices/device_options.h"
#include "palpate/devices/driver.h"
#include "palpate/devices/path.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/fem/material.h"
#include "palpate/haptics/safety.h"
#include "palpate/math/types.h"
#include "palpate/mesh/revolution.h"
#include "palpate/reduction/live_settings.h"
#include "palpate/rigid/link.h"

namespace palpate {

struct DocumentNode;

// A scene as its file states it: plain values in SI units, angles in radians (the file has degrees), z up,
// right-handed. Everything here has been checked by the reader (scene/reader.h): numbers are finite and in range, names
// are unique, references lead somewhere. What only a mesh can tell, e.g. whether a region holds nodes, is the builder's
// to check. Where a part of the file is a room's settings, it is that room's struct, with that room's defaults.

/// How the haptic loop makes its force; `live`, `hsl`, `hsl-exact` and `vc` in files.
enum class MethodName { live, hsl, hsl_exact, vc };
/// What the visual handle is pulled towards: the device sample, or where the device will be when the model is used.
enum class AimName { sample, predicted };
/// Derivative of the step that the handle model holds: stiffness and element rotations frozen, or everything live.
enum class DerivativeName { frozen, full };
/// Where the device's motion comes from: a hand model that pulls the device's mass along the handle's keyframes, the
/// keyframes themselves, a recording, or a device on a desk (isHardware(); in the order of driverKinds()).
enum class DeviceName { simulated, prescribed, recorded, inverse3, touch, force_dimension, spacenavigator };
inline bool isHardware(DeviceName device) { return device > DeviceName::recorded; }
/// Coordinate axis.
enum class AxisName { x, y, z };

/// The name that scene files and the command line use.
const char* toString(MethodName method);
const char* toString(AimName aim);
const char* toString(DerivativeName derivative);
const char* toString(DeviceName device);

/// A file that a scene names.
struct FileReference {
  std::string file;     ///< as written: absolute, relative to the scene's folder or, with a package, to its data folder
  std::string package;  ///< Debian package that brings the file; empty: none
  std::filesystem::path path;  ///< where it was found; empty until resolveFiles() has run
};

// Shapes. Rest coordinates: a procedural shape stands on the origin, i.e. it is centered in x and y and its lowest
// point is at z = 0. So does a surface that `size` scales; files are otherwise taken as they are.

/// The procedural alien toy. It looks along +y, its right hand is at +x; the origin is between its feet.
struct AlienShapeConfig {
  double height = 0.2;       ///< from sole to crown [m]
  double resolution = 0.02;  ///< of its surface, in heights; 0.02 gives 7,560 triangles
};
/// Closed or nearly closed triangle surface, embedded in a lattice of tetrahedra.
struct SurfaceShapeConfig {
  FileReference file;
  std::optional<double>
      size;  ///< longest side of the scaled surface's bounding box [m]; absent: file's units are meters
  /// How far the surface in the scene may be from the file's, to have fewer triangles [m]; absent: EmbedOptions' own
  /// for soft bodies, 0 for others
  std::optional<double> tolerance;
  AxisName up = AxisName::z;  ///< the file's axis that becomes z; y: (x, y, z) -> (x, -z, y), x: (x, y, z) -> (y, z, x)
};
/// Box filled with a regular grid, six tetrahedra a cell; nodes lie on its surface.
struct BarShapeConfig {
  Vec3 size = Vec3::Zero();  ///< full side lengths along x, y, z [m]
  std::array<int, 3> cells{};
};
/// Box as a surface embedded in a lattice.
struct BoxShapeConfig {
  Vec3 size = Vec3::Zero();  ///< full side lengths along x, y, z [m]
};
/// Sphere as a surface embedded in a lattice.
struct SphereShapeConfig {
  double radius = 0.0;  ///< [m]
};
/// Capsule along z as a surface embedded in a lattice.
struct CapsuleShapeConfig {
  double radius = 0.0;  ///< [m]
  double length = 0.0;  ///< from tip to tip [m], >= 2 radius
};
/// Solid of revolution about z as a surface embedded in a lattice: plugs, rings, sockets, bowls.
struct RevolutionShapeConfig {
  RevolutionProfile profile;  ///< checked by profileObjection(); its z is that of the rest frame
  int segments = 48;          ///< around the largest circle
};
/// Tetrahedral mesh from a file, simulated as it is; its boundary is the surface.
struct TetrahedraFileShapeConfig {
  FileReference file;
};
using ShapeConfig =
    std::variant<AlienShapeConfig, SurfaceShapeConfig, BarShapeConfig, BoxShapeConfig, SphereShapeConfig,
                 CapsuleShapeConfig, RevolutionShapeConfig, TetrahedraFileShapeConfig>;

/// Whether the shape is a surface; the others are tetrahedral meshes.
bool isSurface(const ShapeConfig& shape);
/// Horizontal direction in which the shape looks, unit length, rest coordinates. What has no face looks along -y, the
/// side from which drawings are seen.
Vec3 facing(const ShapeConfig& shape);

// Regions of a body, in its rest coordinates [m]; nodes on the boundary belong to them.

struct SphereRegionConfig {
  Vec3 center = Vec3::Zero();
  double radius = 0.0;
};
struct BoxRegionConfig {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Zero();
};
struct CapsuleRegionConfig {
  Vec3 a = Vec3::Zero();  ///< ends of the axis
  Vec3 b = Vec3::Zero();
  double radius = 0.0;
};
/// Points x with normal . (x - point) >= 0.
struct HalfspaceRegionConfig {
  Vec3 point = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< unit length
};
/// Sphere about a named place of the alien, e.g. "head" or "left_hand".
struct LandmarkRegionConfig {
  std::string landmark;
  double radius = 0.0;
};
/// Balls of one size, together: what a brush leaves.
struct SpheresRegionConfig {
  std::vector<Vec3> centers;  ///< at least one
  double radius = 0.0;
};
using RegionConfig = std::variant<SphereRegionConfig, BoxRegionConfig, CapsuleRegionConfig, HalfspaceRegionConfig,
                                  LandmarkRegionConfig, SpheresRegionConfig>;

/// Other material in a region; what the file leaves out is the body's.
struct MaterialPartConfig : ElementMaterial {
  RegionConfig region;
};

struct MaterialConfig : Material {
  /// A tetrahedron belongs to the last part that holds its centroid (scene/region.h), otherwise to the body.
  std::vector<MaterialPartConfig> parts;
};

/// Where the hand wants the handle at a time, or an attachment is, relative to its start: p = p_start + position,
/// R = exp(rotation) R_start, world frame.
struct KeyframeConfig {
  double time = 0.0;             ///< [s] since the start of the run
  Vec3 position = Vec3::Zero();  ///< [m]
  Vec3 rotation = Vec3::Zero();  ///< rotation vector [rad]
};

/// Path of the hand: through the keyframes, holding the first before and the last after.
struct HandConfig {
  std::vector<KeyframeConfig> keyframes;  ///< times increase; empty: the hand rests at the start
  bool smooth = true;                     ///< at rest in every keyframe, smooth in between; otherwise piecewise linear
  Wander wander;                          ///< on top of it; of a tool's hand alone
};

/// Where the world, or another body, holds a body.
struct AttachmentConfig {
  std::string name;
  RegionConfig region;
  std::optional<double> stiffness;  ///< of springs, on the surface in the region [N/m^3]; absent: its nodes are fixed
  double damping = 0.0;             ///< of the springs [N s/m^3]
  std::string to;                   ///< the body that its nodes are glued to; empty: the world holds it
  HandConfig motion;                ///< of its end in the world, about its middle; no keyframes: it stands still
  double period = 0.0;              ///< in which the motion comes again [s]; 0: once
};

/// What tool and bodies share.
struct BodyConfig {
  std::string name;
  ShapeConfig shape;
  int tetrahedra = 300;  ///< wanted count, for shapes that are embedded; BarShapeConfig and files have their own
  Pose pose;             ///< of the rest frame in the world
  MaterialConfig material;
  std::optional<double> friction;             ///< coefficient; absent: ContactConfig::friction
  bool self_contact = true;                   ///< its surface does not pass through itself; rigid bodies need none
  std::vector<AttachmentConfig> attachments;  ///< soft bodies
};

/// A body that nobody holds.
struct FreeBodyConfig : BodyConfig {
  bool rigid = false;            ///< of the material only the density counts; the shape is a surface (isSurface())
  Vec3 velocity = Vec3::Zero();  ///< at the start [m/s], world
  Vec3 angular_velocity = Vec3::Zero();  ///< at the start [rad/s], world, about the rest frame's origin
  bool settled = false;                  ///< starts in static equilibrium; otherwise in its rest shape; soft bodies
};

/// Rigid body that holds the nodes of a region.
struct HandleConfig {
  std::string name;
  RegionConfig region;
  double mass = 0.02;           ///< of the handle alone [kg]
  std::optional<Vec3> inertia;  ///< principal moments of the handle alone [kg m^2], axes of the rest frame; absent: 0.4
                                ///< m r^2 of a ball that spans the region's nodes
  HandConfig hand;
};

/// What the hand holds. A rigid tool is held at its center of mass; its handles have no region.
struct ToolConfig : BodyConfig {
  bool rigid = false;                 ///< of the material only the density counts; the shape is a surface (isSurface())
  std::vector<HandleConfig> handles;  ///< at least one; only the chosen one is attached
  std::string handle;                 ///< the chosen one
  bool settled = true;                ///< starts in static equilibrium; otherwise in its rest shape

  /// The chosen handle.
  const HandleConfig& chosenHandle() const;
  HandleConfig& chosenHandle();
};

// Fixed geometry, world frame.

struct PlaneObstacleConfig {
  Vec3 point = Vec3::Zero();    ///< [m]
  Vec3 normal = Vec3::UnitZ();  ///< unit length, out of the solid
};
struct BoxObstacleConfig {
  Pose pose;                         ///< of its center
  Vec3 half_extents = Vec3::Zero();  ///< [m]
};
struct SphereObstacleConfig {
  Vec3 center = Vec3::Zero();  ///< [m]
  double radius = 0.0;         ///< [m]
};
struct CapsuleObstacleConfig {
  Vec3 a = Vec3::Zero();  ///< ends of the axis [m]
  Vec3 b = Vec3::Zero();
  double radius = 0.0;  ///< [m]
};

/// Any closed surface.
struct MeshObstacleConfig {
  ShapeConfig shape;  ///< isSurface()
  Pose pose;          ///< of the rest frame in the world
};

struct ObstacleConfig {
  std::string name;
  std::variant<PlaneObstacleConfig, BoxObstacleConfig, SphereObstacleConfig, CapsuleObstacleConfig, MeshObstacleConfig>
      geometry;
  std::optional<double> friction;  ///< coefficient; goes before the body's
};

/// Friction between two things, or of one body with itself. No pair is named twice.
struct FrictionPairConfig {
  std::string first;  ///< "tool", a body or an obstacle; the two are not both obstacles
  std::string second;
  double value = 0.0;  ///< coefficient
};

struct ContactConfig {
  ContactSettings settings;               ///< but for the thickness
  std::optional<double> thickness;        ///< [m]; absent: 0.2 % of the tool's bounding-box diagonal
  double friction = 0.5;                  ///< coefficient where neither pair, obstacle nor body has its own
  std::vector<FrictionPairConfig> pairs;  ///< go before all other coefficients
};

/// Without any.
inline DeviceLimits unlimited() {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  return {kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
}

/// Any kind has the limits; the other settings are for a simulated one.
struct DeviceConfig : SimulatedDeviceSettings {
  DeviceName kind = DeviceName::simulated;
  std::optional<FileReference> recording;  ///< of a recorded device
  DeviceOptions options;                   ///< of one on a desk: its driver's and workspaceOptions()
  DeviceLimits caps = unlimited();         ///< the limits that the file gives, for one that has limits of its own
  std::shared_ptr<DeviceDriver> driver;    ///< of one on a desk, once openDevice() has run
  std::vector<std::string> notes;          ///< what openDevice() has changed to fit the device, for people
};

/// What the file gives of the link.
struct LinkConfig {
  std::optional<double> stiffness, damping, rotational_stiffness, rotational_damping, peak_force, peak_torque;
  /// The link with what is given.
  LinkParameters over(LinkParameters link) const;
};

/// Last stage before the device.
struct SafetyConfig {
  SafetySettings settings;                ///< but for what the device's limits say, and the age
  std::optional<double> model_age_limit;  ///< [s]; absent: modelAgeLimit() of visual step and latency
  std::optional<bool> start_gate;         ///< absent: on a device that somebody has to hold
};

struct SceneConfig {
  std::filesystem::path file;                  ///< where it was read from
  std::shared_ptr<const DocumentNode> source;  ///< what was read; null for a scene that was not
  std::string name;
  std::string description;
  Vec3 gravity{0.0, 0.0, -9.81};        ///< [m/s^2]
  double duration = 10.0;               ///< [s]
  double visual_step = 0.033;           ///< [s], ticksPerStep() times haptic_step
  bool visual_step_auto = false;        ///< a run chooses the step, up to that one
  std::optional<double> visual_budget;  ///< what a visual step may cost [s]; absent: stepBudget()
  int substeps = 1;                     ///< equal parts in which a visual step is taken
  bool substeps_auto = false;           ///< as many as fit the time; `substeps` is 1 then
  double haptic_step = 0.001;           ///< [s]
  int latency = 1;                      ///< visual steps until a step's result reaches the haptic loop
  int jitter = 0;                       ///< visual steps that it may be later, by chance; not in real time
  MethodName method = MethodName::live;
  AimName aim = AimName::sample;
  DerivativeName derivative = DerivativeName::frozen;
  LiveSettings live;                 ///< of method `live`
  bool weight_compensation = false;  ///< the device does not feel the tool's static weight
  std::uint64_t seed = 1;            ///< of everything random: `palpate stress`'s motion, `jitter`
  std::optional<Vec3> view_from;     ///< unit vector, world: where pictures of a run look from; absent: viewFrom()
  ContactConfig contact;
  ToolConfig tool;
  std::vector<FreeBodyConfig> bodies;
  std::vector<ObstacleConfig> obstacles;
  LinkParameters link;  ///< what the file leaves out is what the device's limits allow
  LinkConfig link_given;
  DeviceConfig device;
  SafetyConfig safety;

  /// Haptic ticks in a visual step.
  int ticksPerStep() const;
  /// Direction from the bodies to whoever looks at pictures of them, unit length, world: `view_from`, or three quarters
  /// from the front of the tool's rest shape and from above.
  Vec3 viewFrom() const;
};

}  // namespace palpate
