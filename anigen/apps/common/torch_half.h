#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"

namespace anigen {

namespace eval {
struct EvaluationRequest;
struct SkinMethod;
}  // namespace eval
namespace prepare {
class FeatureExtractor;
struct FeatureOptions;
}  // namespace prepare
namespace rigging {
struct LearnedSteps;
}  // namespace rigging

struct AnimateArguments;
struct CommonOptions;
struct EncodeArguments;
struct EvalArguments;
struct GenerateArguments;
struct RigArguments;

/// The command line of anigen-train.
struct TrainArguments {
  std::vector<std::string> words;  ///< argv
  std::filesystem::path config, output, load, export_to;
  std::string export_precision = "half";
  std::string dataset, ckpt = "latest", warm_start;
  std::vector<std::string> overrides;
  bool restart = false, schema = false, print_config = false, tune = false;
  std::int64_t profile_steps = 0, extend_to = 0;
  // Several processes.
  int ranks = 1, rank_restarts = 0;
  double rank_timeout = 60.0;  ///< seconds without a sign of life after which a rank is lost
  std::string rendezvous, communication = "fp32";
  bool ranks_given = false;
  std::vector<std::string> only_of_ranks;  ///< options that were given and mean something to several processes alone
};

/// The half of the project that needs LibTorch, as the programs call it. LibTorch brings some 280 shared libraries that
/// take half a second to load, so the programs do not link it: they load this half when a command needs it, after the
/// command line was read. Every function throws as the one it stands for.
struct TorchHalf {
  /// Lines of --version: LibTorch, BLAS, kernels, CUDA (nn/profile.h).
  std::string (*version_details)();

  // Whole programs; results go to standard output.
  void (*encode)(const EncodeArguments& arguments, const CommonOptions& common);
  void (*generate)(const GenerateArguments& arguments, const CommonOptions& common);
  /// @return the exit status of ranks that it has started, else 0
  int (*train)(const TrainArguments& arguments, const CommonOptions& common);
  /// Reads the config of a training with its changes, and no dataset. @throws InputError
  void (*check_config)(const TrainArguments& arguments, const CommonOptions& common);

  // Parts of programs.
  /// anigen-animate --video.
  void (*animate_from_video)(const AnimateArguments& arguments, const CommonOptions& common);
  /// anigen-rig --method retrieval.
  void (*retrieve)(const RigArguments& arguments, const CommonOptions& common);
  /// anigen-rig --method anigen, anymate or rignet; for auto the joints that it is sure of (LearnedSteps::sure).
  rigging::LearnedSteps (*learned_steps)(const RigArguments& arguments, const CommonOptions& common);
  /// anigen-rig --skin learned: the step that binds.
  rigging::LearnedSteps (*learned_skin)(const RigArguments& arguments, const CommonOptions& common);
  /// anigen-eval --lpips-weights and --image-encoder: sets the request's perceptual distances.
  void (*add_perceptual_distances)(const EvalArguments& arguments, const CommonOptions& common,
                                   eval::EvaluationRequest& request);
  /// anigen-eval --skin-ae: weights encoded by a trained skin auto-encoder and decoded again.
  eval::SkinMethod (*skin_reconstruction)(const std::string& run, const CommonOptions& common, Json& settings);
  /// anigen-eval --skin-run: corrected weights and those that they correct.
  std::vector<eval::SkinMethod> (*skin_corrections)(const std::vector<std::string>& runs, const CommonOptions& common,
                                                    Json& settings);
  /// anigen-eval --ss-flow.
  void (*evaluate_structures)(const EvalArguments& arguments, const CommonOptions& common);
  /// anigen-eval --matting-network.
  void (*evaluate_matting)(const EvalArguments& arguments, const CommonOptions& common);
  /// anigen-eval --oracle. @param pairs all of the request but its predictions
  void (*evaluate_oracle)(const EvalArguments& arguments, const CommonOptions& common,
                          const eval::EvaluationRequest& pairs);
  /// anigen-inspect --weights: adds "weights" to the description. @return a sentence on the first incomplete one, or ""
  std::string (*describe_weights)(const std::string& run, Json& description);
  /// anigen-prepare --features.
  std::unique_ptr<prepare::FeatureExtractor> (*feature_extractor)(const prepare::FeatureOptions& options);
};

/// Loads the half on the first call (core/torch_module.h). @throws Error naming the file when it cannot be loaded;
/// NotSupportedError in a build without LibTorch, which names `what`
const TorchHalf& torch_half(const std::string& what);

}  // namespace anigen
