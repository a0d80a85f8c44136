#include "anigen/engine/module.h"

#include <mutex>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/torch_module.h"

namespace anigen::engine {

const EngineModule& engine_module(const std::string& what) {
#ifdef ANIGEN_WITH_TORCH
  static_cast<void>(what);
  using Entry = const EngineModule* (*)();
  static const EngineModule& module = *reinterpret_cast<Entry>(torch_module_entry("anigen_engine_module"))();
  return module;
#else
  throw NotSupportedError("", "", what + " in a build without LibTorch");
#endif
}

rigging::SureJoints sure_joints() {
#ifdef ANIGEN_WITH_TORCH
  return [](const io::RiggedShape& shape, std::string& why_not) {
    return engine_module("learned joints").sure_joints()(shape, why_not);
  };
#else
  return {};
#endif
}

void quiet_log() {
  static std::once_flag once;
  std::call_once(once, [] {
    // spdlog's own logger has no name and writes to standard output.
    if (!spdlog::default_logger()->name().empty()) return;
    log::setup("warn");
    Progress::set_quiet(true);
  });
}

}  // namespace anigen::engine
