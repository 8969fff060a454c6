#pragma once

#include <memory>

#include "palpate/palpate.h"
#include "palpate/scene/builder.h"
#include "palpate/session/run_timing.h"
#include "palpate/threads/thread_team.h"

namespace palpate::v0 {

struct World::Impl {
  Impl(SceneConfig of, int threads);

  SceneConfig config;
  BuiltScene scene;
  RunTiming timing;
  std::unique_ptr<ThreadTeam> team;
  palpate::HandleModel last;  // of visualStep()
  double last_step = 0;       // that can be linearized [s]; 0: none
};

/// The record of a step for the user.
VisualStep visualStepOf(const VisualRecord& record);

}  // namespace palpate::v0
