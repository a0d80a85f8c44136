#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// fp16, bf16, fp32 or fp64.
bool is_floating_point(io::Dtype dtype);

/// For weights that come from elsewhere. @param file for messages
/// @throws InputError naming the key of an array that is not floating-point, or that holds a value that is not finite
void check_weight_values(const io::NamedArrays& arrays, const std::string& file);

/// One parameter or buffer of a model under its state-dict key (the path of module names joined by '.').
struct StateEntry {
  std::string key;
  torch::Tensor tensor;  ///< shares storage with the model
  bool is_buffer = false;
};

/// Parameters and buffers in the order of registration: a module's own parameters, its own buffers, then its children
/// one after another. This is the order of published state dicts.
std::vector<StateEntry> state_entries(const torch::nn::Module& module);

/// Copies of all entries, in that order and in their run-time dtype.
io::NamedArrays state_dict(const torch::nn::Module& module);

enum class LoadMode {
  kStrict,    ///< every key must match
  kNonStrict  ///< keys that only one side has are left alone, as the published loader does
};

struct LoadReport {
  std::vector<std::string> missing;     ///< keys of the model that the arrays lack
  std::vector<std::string> unexpected;  ///< keys of the arrays that the model lacks
};

/// Copies the arrays into the model, converted to its run-time dtype (fp32 → fp16 rounds to nearest). Nothing is
/// written before everything was checked.
/// @param source file name for messages
/// @throws InputError naming the key and both shapes on a shape mismatch, in either mode; in strict mode also naming
///   missing and unexpected keys
LoadReport load_state_dict(torch::nn::Module& module, const io::NamedArrays& arrays, LoadMode mode,
                           const std::string& source = "");
/// Overload that frees each array's bytes as soon as they are in the model: a file of gigabytes then needs its size
/// once, since memory that a model was given without initial values is not used before it is written.
LoadReport load_state_dict(torch::nn::Module& module, io::NamedArrays&& arrays, LoadMode mode,
                           const std::string& source = "");

/// Takes the key of a tensor that has been read.
using LoadedKey = std::function<void(const std::string& key)>;

/// load_state_dict() from a file (io::read_state_dict()), strictly, one tensor in memory at a time: a model of
/// gigabytes then needs no second copy. @param loaded called for every tensor once it is in the model, which it may
/// convert to another dtype @throws InputError as load_state_dict(); the model is then of no use
void load_state_file(torch::nn::Module& module, const std::filesystem::path& file, const LoadedKey& loaded = {});

/// The dtype that each entry has in the published system: fp16 for the parameters of Linear and convolution layers
/// below one of the named modules ("skin_decoder.blocks_skin") and for parameters that are named themselves, fp32 for
/// every other floating-point entry. Differs from the tensor's own dtype where we compute in fp32, as on a CPU
/// (docs/reference/autoencoders.md, 1.4).
/// @return one per entry of state_entries, in its order
std::vector<torch::Dtype> published_dtypes(const torch::nn::Module& module,
                                           const std::vector<std::string>& half_precision_modules);

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

/// The run folder that another run's config names. A relative name counts from the working directory, as published;
/// where nothing is there, from the nearest parent folder of the naming run in which it exists, so that a released tree
/// works from anywhere ("ckpts/anigen/ss_dae" in ckpts/anigen/ss_flow_duet/config.json).
/// @param run the naming run's folder @param config, pointer where the name stands, for messages
/// @throws InputError when the name is empty or no such folder exists
std::filesystem::path named_run(const std::filesystem::path& run, const std::string& name,
                                const std::filesystem::path& config, const std::string& pointer);

/// True when a folder's checkpoints lie beside the state of the training that wrote them; a published folder has none.
/// @throws InputError when its files cannot be listed
bool has_training_state(const std::filesystem::path& run);

/// True when weights or their moving average (EMA) are wanted.
enum class Averages { kUsual, kAlways, kNever };

/// As above, for a flow, of any of several class names. Without a name of a file kUsual takes what the kind of folder
/// is usually used with: the newest averages of a run that was trained here, the weights themselves of a published
/// folder (docs/reference/flows.md, 6.2). @throws InputError as find_run_model(), also when what is asked for is
/// missing
RunModel find_flow_model(const std::filesystem::path& run, const std::vector<std::string>& class_names,
                         const std::string& ckpt = "", Averages averages = Averages::kUsual);

/// The file find_run_model() takes without a name. @param folder the run's, or its ckpts/ @param averaged of one step
/// the averages go before the weights themselves, else the other way round; of several averages that which the training
/// evaluates, the first of ema_rate in config.json
std::filesystem::path newest_checkpoint(const std::filesystem::path& folder, const std::string& model,
                                        bool averaged = true);

/// Loads a model of a run for use, strictly: evaluation mode, nothing asks for gradients. @param loaded as
/// load_state_file() @throws InputError when the weights do not fit
void load_trained_weights(torch::nn::Module& model, const RunModel& found, torch::Device device,
                          const LoadedKey& loaded = {});

/// A model of a run, without weights. @tparam Model a holder with options() @param found by find_run_model()
/// @throws InputError when arguments do not fit
template <typename Model>
Model model_without_weights(const RunModel& found) {
  using Options = std::decay_t<decltype(std::declval<Model&>()->options())>;
  return Model(Options::from_json(found.args, found.config.string(), found.pointer), Init::kNone);
}

/// A trained model for use: weights loaded strictly, in fp32, evaluation mode, nothing asks for gradients.
/// @throws InputError when arguments or weights do not fit
template <typename Model>
Model load_trained(const RunModel& found, torch::Device device) {
  Model model = model_without_weights<Model>(found);
  load_trained_weights(*model, found, device);
  return model;
}

}  // namespace anigen::nn
