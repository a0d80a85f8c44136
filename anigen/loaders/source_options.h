#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// Which assets a dataset uses: the arguments all dataset classes share (reference training-and-data.md, 1.4). The
/// class adds its own filters to `filter`.
struct SourceOptions {
  std::string data_dir;        ///< ours: comma-separated roots; --data-dir sets it
  std::string split;           ///< ours: file of ids to use; relative to the first root, else to the working directory
  std::string eval_split;      ///< ours: file of ids held out for evaluation; never trained on
  double eval_fraction = 0.0;  ///< ours, without eval_split: this share of the ids, chosen by a hash of the id
  double train_share = 1.0;    ///< ours: this share of the training ids, chosen by a hash; smaller in larger ones
  bool skip_broken = false;    ///< ours: leave out assets that cannot be read, counted and named
  RowFilter filter;  ///< ours: `repeat_sources`, for example {"real": 8}, visits assets of a source that often an epoch

  /// data_dir, split, eval_split, eval_fraction, train_share, skip_broken, repeat_sources, `instances` (a list of ids)
  /// and `min_aesthetic_score` (default 5). @throws InputError
  void read_common(ConfigReader& reader);
};

struct TrainAndEval {
  std::vector<AssetId> train, eval;
};

/// `name` below the first root of `data_dir` when that exists, else `name` itself.
std::filesystem::path file_of_dataset(const std::string& name, const std::string& data_dir);

/// Applies filters and splits. @throws InputError when nothing is left to train on, or a held-out split is empty
TrainAndEval select(const SourceOptions& options);

}  // namespace anigen::loaders
