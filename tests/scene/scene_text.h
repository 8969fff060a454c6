#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "palpate/common/error.h"

namespace palpate {

/// The message of the InputError that `action` throws; fails the test if it throws none or something else.
inline std::string rejection(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "not an InputError: " << error.what();
    return "";
  }
  ADD_FAILURE() << "accepted";
  return "";
}

/// The text with the first `from`, which must be there, replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  if (place == std::string::npos) {
    ADD_FAILURE() << "no " << from << " in the text";
    return text;
  }
  return text.replace(place, from.size(), to);
}

/// A scene in which every part of the schema appears, with values that are no defaults.
inline const std::string kFullScene = R"(palpate: 1
name: everything
description: all keys
gravity: [0.1, -0.2, -9.5]
duration: 7
method: hsl-exact
aim: predicted
latency: 2
seed: 18446744073709551615
view: {from: [0, -3, 4]}
visual: {step: 0.02, substeps: 3}
haptic: {step: 0.002}
contact:
  cone: exact
  facets: 12
  friction: 0.7
  pairs:
    - {between: [tool, ground], friction: 0.8}
    - {between: [tool, tool], friction: 0.1}
    - {between: [stone, cushion], friction: 0.6}
  thickness: 0.0006
  max_recovery_speed: 0.25
  margin: 0.004
  penetration_tolerance: 2.0e-5
  max_passes: 6
  reduction: false
  solver: {max_iterations: 500, tolerance: 1.0e-8}
linearization: {derivative: full}
tool:
  shape: {alien: {height: 0.3, resolution: 0.03}}
  tetrahedra: 288
  pose: {position: [0.1, 0.2, 0.3], rotation: [0, 0, 90]}
  material:
    youngs_modulus: 3.0e4
    poisson_ratio: 0.3
    density: 250
    damping_alpha: 0.5
    damping_beta: 0.001
    parts:
      - {region: {halfspace: {point: [0, 0, 0.2], normal: [0, 0, 1]}}, youngs_modulus: 5.0e4}
      - {region: {sphere: {center: [0, 0, 0.25], radius: 0.06}}, youngs_modulus: 9.0e5, poisson_ratio: 0.2, density: 600}
  friction: 0.9
  self_contact: false
  handle: grip
  handles:
    ball:
      region: {sphere: {center: [0.01, 0.02, 0.03], radius: 0.04}}
    grip:
      region: {landmark: {name: left_hand, radius: 0.05}}
      mass: 0.03
      inertia: [1.0e-5, 2.0e-5, 2.5e-5]
      hand:
        smooth: false
        keyframes:
          - {t: 0}
          - {t: 1.5, position: [0.01, 0.02, 0.03], rotation: [0, 180, 0]}
    brick:
      region: {box: {min: [-1, -2, -3], max: [1, 2, 3]}}
    rod:
      region: {capsule: {a: [0, 0, 0], b: [0, 0, 1], radius: 0.1}}
    top:
      region: {halfspace: {point: [0, 0, 0.1], normal: [0, 0, 4]}}
bodies:
  - name: cushion
    shape: {bar: {size: [0.1, 0.2, 0.3], cells: [2, 3, 4]}}
    velocity: [1, 2, 3]
    angular_velocity: [180, 0, 0]
    friction: 0.2
    start: settled
  - shape: {surface: {file: a.obj, size: 0.2, up: y}}
    tetrahedra: 100
  - shape: {box: {size: [0.1, 0.1, 0.2]}}
  - shape: {sphere: {radius: 0.05}}
  - shape: {capsule: {radius: 0.02, length: 0.1}}
  - shape: {tetrahedra_file: b.msh}
  - name: stone
    rigid: true
    density: 2600
    shape: {revolution: {profile: [[0, 0], [0.01, 0], [0.02, 0.03], [0, 0.03]], segments: 24}}
obstacles:
  - {name: ground, plane: {point: [0, 0, 1], normal: [0, 3, 4]}, friction: 0.3}
  - {box: {center: [1, 2, 3], half_extents: [0.1, 0.2, 0.3], rotation: [90, 0, 0]}}
  - {sphere: {center: [4, 5, 6], radius: 0.5}}
  - {capsule: {a: [0, 0, 0], b: [1, 0, 0], radius: 0.05}}
  - {mesh: {shape: {box: {size: [0.1, 0.1, 0.001]}}, pose: {position: [7, 8, 9], rotation: [0, 90, 0]}}, friction: 0.4}
link: {stiffness: 600, damping: 4, rotational_stiffness: 0.9, rotational_damping: 0.004, peak_force: 7, peak_torque: 0.3}
device:
  type: recorded
  file: motion.csv
  mass: 0.05
  inertia: 2.0e-4
  damping: 0.3
  rotational_damping: 6.0e-4
  hand_stiffness: 400
  hand_damping: 7
  hand_rotational_stiffness: 1.5
  hand_rotational_damping: 0.02
  limits: {peak_force: 8, continuous_force: 2, peak_torque: 0.2, stiffness: 900, damping: 6, rotational_stiffness: 2, rotational_damping: 0.006, workspace_radius: 0.2}
safety:
  max_slew: 500
  start_ramp: 0.3
  gap_limit: 0.04
  gap_ramp: 0.7
  model_age_limit: 0.2
  dead_man: 3
  start_gate: true
  workspace: 0.15
  frozen_limit: 1.5
  stop_swings: false
  passivity: {allowance: 0.02, max_damping: 1.5, max_rotational_damping: 0.004}
weight_compensation: true
jitter: 3
)";

/// The least that a scene can be.
inline const std::string kSmallScene = R"(palpate: 1
name: small
tool:
  shape: {sphere: {radius: 0.05}}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.08], normal: [0, 0, 1]}}
)";

}  // namespace palpate
