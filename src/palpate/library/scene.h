#pragma once

#include <string>

#include "palpate/palpate.h"
#include "palpate/scene/config.h"

namespace palpate::v0 {

struct Scene::Impl {
  std::string name;  // in errors
  std::string text;
  SceneConfig config;
};

}  // namespace palpate::v0
