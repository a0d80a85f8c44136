#pragma once
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/engine/generator.h"
#include "anigen/prepare/metadata.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::engine {

/// Models of a Generator, behind the module that needs LibTorch.
class GeneratorWork {
 public:
  virtual ~GeneratorWork() = default;
  /// @param contents of the encoded image, where it is in memory; empty: that of the file
  virtual Generated generate(const std::filesystem::path& image, const std::string& contents,
                             const GenerateOptions& options) = 0;
};

/// The module with LibTorch, as the engine calls it. Every function throws as the one it stands for.
struct EngineModule {
  std::unique_ptr<GeneratorWork> (*generator)(const GeneratorOptions& options);
  /// Joints by the shipped flows, loaded once; its `why_not` says so where there are no weights.
  rigging::SureJoints (*sure_joints)();
  std::unique_ptr<prepare::FeatureExtractor> (*feature_extractor)(const prepare::FeatureOptions& options);
};

/// @throws NotSupportedError in a build without LibTorch, which names `what`; Error when the module cannot be loaded
const EngineModule& engine_module(const std::string& what);

/// Joints by the shipped flows, which are loaded for the first mesh that asks. Empty in a build without LibTorch.
rigging::SureJoints sure_joints();

/// In a process that has set up no log of its own: warnings and errors alone, to standard error, and no progress bars.
void quiet_log();

}  // namespace anigen::engine
