#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::train {

/// Outcome of export_run().
struct ExportedRun {
  std::vector<std::string> models;
  std::int64_t step = 0;  ///< of the newest checkpoint
  std::size_t parameters = 0;
  std::uintmax_t bytes = 0;  ///< of the files of weights
};

enum class ExportPrecision {
  kHalf,
  kInt8  ///< matrices and kernels by io::quantize_rows(), half the bytes of kHalf
};

/// Writes what others need of a trained run into a folder of the run's name, weights in fewer bits: of every model the
/// averaged weights of the newest checkpoint, or the weights where there are no averages, as
/// ckpts/<model>_step<N>.safetensors; config.json, in which folders of other runs are named by their last part, so that
/// runs exported side by side find each other, which knows no dataset, and whose splits are files of its folder splits;
/// grouping.json where there is one. A frozen model's weights count, too. What of a state is no weight (buffers of
/// indices) keeps its type.
/// @param run run folder @param folder of exported runs, made if needed
/// @throws InputError without checkpoints, or when weights are not finite or too large for half precision; Error when
/// the disk refuses
ExportedRun export_run(const std::filesystem::path& run, const std::filesystem::path& folder,
                       ExportPrecision precision = ExportPrecision::kHalf);

}  // namespace anigen::train
