#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"

namespace anigen::data {

/// An asset of a dataset: the root that holds it and its id (the `sha256` column of metadata.csv).
struct AssetId {
  std::filesystem::path root;
  std::string id;
  std::size_t repeat = 1;        ///< how often an epoch visits it
  std::uint64_t num_voxels = 0;  ///< column num_voxels; 0 where there is none
  bool is_bad_skin = false;      ///< column is_bad_skin
  std::string creature{};        ///< column file_identifier of a procedural creature, "procedural/<seed>/<index>"
  std::string source{};          ///< column source, of a procedural creature "procedural:<family>"
  std::string variant_of{};      ///< column variant_of, the id of which this is another pose; "" for none
};

/// Filters on the rows of metadata.csv (docs/reference/training.md, 1.1 and 1.3). A filter on a column that a source
/// does not have lets every row pass, except is_test, without which there is no test split.
struct RowFilter {
  double min_aesthetic_score = 5.0;                ///< column aesthetic_score
  std::optional<long long> max_num_voxels;         ///< column num_voxels
  bool drop_bad_skeleton = true;                   ///< column is_bad_skeleton
  bool drop_bad_skin = false;                      ///< column is_bad_skin
  std::optional<bool> is_test;                     ///< keep rows whose is_test equals this
  std::vector<std::string> required_flags;         ///< boolean columns that must be present and true
  std::vector<std::string> required_columns;       ///< columns that must be present
  std::optional<std::set<std::string>> only;       ///< ids of a split file
  std::optional<std::set<std::string>> instances;  ///< ids that the config lists
  std::map<std::string, std::size_t> repeat;       ///< column source → AssetId::repeat, for small sources that matter

  /// The filters of AniGenSparseFeat2Skeleton: max_num_voxels, filter_bad_skin, test_mode, is_test. @throws InputError
  void read_rigged(ConfigReader& reader);
};

/// Ids of a split file: one per line; empty lines and lines that start with '#' do not count.
/// @throws InputError when it cannot be read or holds none
std::set<std::string> read_split(const std::filesystem::path& file);

/// The ids (`sha256`) that a split file names in the roots of `data_dir`: a line may be any name of an asset that
/// io::NameIndex knows, such as its uuid. Lines that name none stay as they are, since a root may lack them.
/// @throws InputError also when several assets could be meant by a line
std::set<std::string> read_split(const std::filesystem::path& file, const std::string& data_dir);

/// Ids that pass, in the table's order. @param root only recorded @throws InputError naming the filter that left
/// nothing and how many rows there were before it, a missing column or a cell that is no number or boolean
std::vector<AssetId> select_rows(const CsvTable& table, const std::filesystem::path& root, const RowFilter& filter);

/// Reads `<root>/metadata.csv` of every root, in order. @param data_dir comma-separated roots
std::vector<AssetId> select_assets(const std::string& data_dir, const RowFilter& filter);

/// Choice of the assets of a dataset: the arguments all dataset classes share (docs/reference/training.md, 1.3). The
/// class adds its own filters to `filter`.
struct SourceOptions {
  std::string data_dir;        ///< ours: comma-separated roots; --dataset sets it
  std::string split;           ///< ours: file of ids to use; relative to the first root, else to the working directory
  std::string eval_split;      ///< ours: file of ids held out for evaluation; never trained on
  double eval_fraction = 0.0;  ///< ours, without eval_split: this share, chosen by a hash of the id; poses go with it
  double train_share = 1.0;    ///< ours: this share of the training ids, chosen so, too; smaller in larger ones
  bool skip_broken = false;    ///< ours: leave out assets that cannot be read, counted and named
  std::vector<std::string> test_splits;  ///< ours: files of ids of which no asset may be trained on, of any dataset
  RowFilter filter;  ///< ours: `repeat_sources`, for example {"real": 8}, visits assets of a source that often an epoch

  /// data_dir, split, eval_split, eval_fraction, train_share, skip_broken, test_splits, repeat_sources, `instances` (a
  /// list of ids) and `min_aesthetic_score` (default 5). @throws InputError
  void read_common(ConfigReader& reader);
};

struct TrainAndEval {
  std::vector<AssetId> train, eval;
  std::string roots;  ///< comma-separated; of a stream its shards
};

/// `name` below the first root of `data_dir` when that exists, else `name` itself. Below a stream nothing lies; the
/// root after it counts as the first.
std::filesystem::path file_of_dataset(const std::string& name, const std::string& data_dir);

/// Shards of a stream (anigen-prepare --stream), which stay on the disk while this lives.
struct StreamGeneration {
  std::uint64_t number = 0;
  std::vector<std::uint64_t> shards;
  std::vector<FileLock> locks;
};

/// The stream among the roots of `data_dir`. @throws NotSupportedError for several
std::optional<StreamFolder> stream_of(const std::string& data_dir);
/// The generation that is there now. @throws InputError when the first one is not made yet
std::shared_ptr<const StreamGeneration> newest_generation(const StreamFolder& folder);
/// The shards of some generation; null when one of them is gone
std::shared_ptr<const StreamGeneration> hold_generation(const StreamFolder& folder, std::uint64_t number,
                                                        const std::vector<std::uint64_t>& shards);

/// Applies filters and splits. Of a stream all shards of a generation are taken, by a split those that the split file
/// of each names; held-out assets come from the other roots, and from `eval_split` alone.
/// @param generation of the stream among the roots; null where there is none
/// @throws InputError when nothing is left to train on, or a held-out split is empty; NotSupportedError for a stream
/// without a generation, by who cannot follow it
TrainAndEval select(const SourceOptions& options, const StreamGeneration* generation = nullptr);

/// Refuses to train on creatures that are kept for testing: of a seed for tests (core/random.h), a test asset of one of
/// the roots by column is_test, or named in one of options.test_splits by id or creature. Posed variants are of the
/// creature they come from. @throws InputError naming asset and seed
void refuse_test_creatures(const TrainAndEval& assets, const SourceOptions& options);

/// Handling of assets that turned out unreadable before training begins: an error that counts them and names the
/// first, or with skip_broken a warning for each. @throws InputError also when none of `assets` is left
void report_broken(const std::vector<std::string>& problems, std::size_t assets, bool skip_broken);

/// Assets that could not be read while training: each is named in the log once. Thread-safe.
class BrokenAssets {
 public:
  void note(const std::string& id, const std::string& problem);
  std::map<std::string, std::string> problems() const;  ///< id → what is wrong with it

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::string> problems_;
};

}  // namespace anigen::data
