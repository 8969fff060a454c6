#pragma once

// A scene as its file has it, for what begins with one.

#include "palpate/scene/reader.h"

namespace palpate::test {

/// A small scene that builds in milliseconds: a soft cube over the ground, pressed down by its own path.
inline SceneConfig softCube() {
  return readSceneFromString(R"(
palpate: 1
name: cube
duration: 2
visual: {step: 0.02}
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [2, 2, 2]}}
  pose: {position: [0, 0, 0.002]}
  material: {youngs_modulus: 2.0e4, poisson_ratio: 0.4, density: 300, damping_beta: 0.002}
  handle: top
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}
      mass: 0.02
      hand: {keyframes: [{t: 0.1}, {t: 0.5, position: [0, 0, -0.01]}]}
    side:
      region: {halfspace: {point: [0.0299, 0, 0], normal: [1, 0, 0]}}
      mass: 0.02
bodies:
  - name: ball
    rigid: true
    shape: {sphere: {radius: 0.01}}
    pose: {position: [0.2, 0, 0.05]}
    density: 500
obstacles:
  - {name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}, friction: 0.5}
  - {name: box, box: {center: [0, 0.3, 0], half_extents: [0.02, 0.02, 0.02]}}
)",
                             "cube.yaml");
}

}  // namespace palpate::test
