#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::models {

/// A model of a finished or published run, found but not yet built.
struct RunModel {
  std::string name;                  ///< in the config: "encoder", "decoder", "denoiser"
  Json args;                         ///< of its class
  std::filesystem::path config;      ///< the run's config.json
  std::string pointer;               ///< of args in it, for messages
  std::filesystem::path checkpoint;  ///< the file with its weights
  Json run;                          ///< the whole config
};

/// Looks for a model in a run folder (config.json and ckpts/).
/// @param class_name what the config calls the model's class, such as "AniGenSparseStructureEncoder"
/// @param ckpt file chosen by name: `<model>_<ckpt>` or `<ckpt>` (io::choose_checkpoint). "" — and "final", the
///   published default, where there is no such file — takes the highest step of the model's own files; of one step the
///   averaged (EMA) weights. Where the state of a training lies beside them, which is written last, steps with a state
///   go before all others: their files belong together.
/// @throws InputError naming folder or file when the run, the model or its weights are missing
RunModel find_run_model(const std::filesystem::path& run, const std::string& class_name, const std::string& ckpt = "");

/// Whether a folder's checkpoints lie beside the state of the training that wrote them; a published folder has none.
/// @throws InputError when its files cannot be listed
bool has_training_state(const std::filesystem::path& run);

/// Whether weights or their moving average (EMA) are wanted.
enum class Averages { kUsual, kAlways, kNever };

/// The same for a flow, of any of several class names. Without a name of a file kUsual takes what the kind of folder is
/// usually used with: the newest averages of a run that was trained here, the weights themselves of a published folder
/// (reference flows-and-pipeline.md, 6.4). @throws InputError as find_run_model(), also when what is asked for is
/// missing
RunModel find_flow_model(const std::filesystem::path& run, const std::vector<std::string>& class_names,
                         const std::string& ckpt = "", Averages averages = Averages::kUsual);

/// The file find_run_model() takes without a name. @param folder the run's, or its ckpts/ @param averaged of one step
/// the averages go before the weights themselves, else the other way round
std::filesystem::path newest_checkpoint(const std::filesystem::path& folder, const std::string& model,
                                        bool averaged = true);

}  // namespace anigen::models
