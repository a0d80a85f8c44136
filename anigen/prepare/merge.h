#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/prepare/manifest.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

/// Adds to a new metadata.csv the columns of the earlier one that preparing does not write: what other programs know
/// of the assets, such as anigen-encode's ss_latent_<name>. Cells follow the ids (`sha256`); a new asset has False in a
/// column of True and False, and an empty cell in any other. Columns that preparing writes at times, and leaves out now
/// (aesthetic_score, near_skeleton_of, feature_<model>), are not carried over. @param earlier without ids: nothing
void carry_over_columns(CsvTable& table, const CsvTable& earlier);

/// Handling of an asset whose skeleton is nearly that of an earlier one (near_duplicates()).
enum class NearSkeletons { kIgnore, kFlag, kDrop };
NearSkeletons parse_near_skeletons(const std::string& word);  ///< ignore, flag, drop @throws InputError
const char* name_of(NearSkeletons choice);
/// Choice of a preset of cleaning rules: Anymate's data are free of redundant assets (docs/reference/anymate.md, 1.1),
/// so "anymate" drops; all others flag. @param preset as cleaning_preset()
NearSkeletons near_skeletons_of_preset(const std::string& preset);

/// One line of metadata.csv.
struct DatasetEntry {
  std::string id;
  AssetSource source;
  AssetRecord record;
  bool is_test = false;
};

/// One asset of the finished dataset.
struct DatasetRow {
  DatasetEntry entry;
  StepRecords records;
  std::size_t variant = 0;  ///< 0: the source itself, k + 1: its posed variant k
  std::string variant_of;   ///< id of the source of a variant made here; empty for the source itself
  std::string aesthetic_score;
  std::string near_skeleton_of;  ///< id of an earlier asset; empty: none

  const Json& columns(const std::string& step) const { return records.columns(step); }
};

/// A source, or a variant, that did not get into the dataset.
struct Rejected {
  std::string file_identifier;
  std::string reason;
  std::string step;  ///< that failed; "identify" for a repeated content
  std::string rule;  ///< of cleaning, when one dropped it
};
ANIGEN_JSON_RECORD(Rejected, file_identifier, reason, step, rule)

/// Rows of the manifests and the records together.
struct DatasetRows {
  std::vector<DatasetRow> rows;  ///< in order of sources; each source before its variants
  std::vector<Rejected> rejected;
  std::vector<std::pair<AssetSource, StepFailure>> failures;  ///< every step that failed, in order
  std::size_t rejected_poses = 0;
};

/// @throws InputError when a record that a manifest promises is missing or damaged
DatasetRows collect_rows(const std::filesystem::path& out, const std::vector<Manifest>& manifests, const StepPlan& plan,
                         NearSkeletons near);

/// metadata.csv: what is known of the assets themselves, then the published flags of what is there (rendered,
/// voxelized, num_voxels, cond_rendered, feature_<model>) and our own. aesthetic_score appears when every row has one.
CsvTable dataset_table(const std::vector<DatasetRow>& rows, const QualityLimits& limits);

/// Split of usable assets. Variants follow their source: those of a test asset are never trained on.
struct SplitOptions : JsonOptions<SplitOptions> {
  std::uint64_t seed = 0;
  /// Of the usable real assets. Without this and without a count, a source that brings its own test flags keeps them,
  /// and 0.333 holds where none does.
  std::optional<double> test_fraction;
  std::optional<std::size_t> test_count;  ///< of the usable real assets
  std::size_t procedural_test = 0;        ///< of the usable procedural assets
  /// test_fraction and test_count are of the skeletons of the usable real assets: those whose trees are equal up to the
  /// order of children stay on one side, so that a test skeleton was never trained on.
  bool by_skeleton = false;
  /// Names of all test assets, real and procedural: uuid, sha256, path or "<shard>#<uuid>" (io::NameIndex). Not empty:
  /// the three numbers above and the sources' own flags do not count.
  std::vector<std::string> test_names;

  /// @throws InputError for a fraction outside [0, 1]
  void validate() const;
  void fields(ConfigFields& f);
};

struct SplitCounts {
  std::size_t train = 0, test = 0, unusable = 0;
};

/// Sets is_test of every row. Warns of test_names that no asset has. @throws InputError when more are asked for than
/// are usable, no asset has one of test_names, or several could be meant by one
void mark_test(std::vector<DatasetRow>& rows, const SplitOptions& options, const QualityLimits& limits);

/// splits/train.txt, test.txt, test_variants.txt and unusable.txt: ids, one a line. Atomic.
SplitCounts write_splits(const std::filesystem::path& out, const std::vector<DatasetRow>& rows,
                         const QualityLimits& limits);

/// Missing parts of a dataset that should be complete: of every source and every posed variant there must be a record
/// or the failure that kept it out; every step of the plan must be recorded, unless one of this asset failed, and of
/// every such record all files must be there, with as many bytes as it says. Looks at names and sizes, on all threads,
/// and reads no contents: files come into being by rename, so one of the right size is whole.
/// @return a sentence per gap, in order of the sources; empty: nothing is missing
std::vector<std::string> find_gaps(const std::filesystem::path& out, const std::vector<Manifest>& manifests,
                                   const StepPlan& plan);

/// The tasks of one phase of a run, cut into pieces that processes take by lease; what became of a piece is the file
/// run/pieces/<phase>-<shard>-<number>.json, which all of them read.
class Pieces {
 public:
  /// @param per_piece tasks that are leased together, at least 1
  Pieces(const std::filesystem::path& out, const std::string& phase, const Shard& shard, std::size_t tasks,
         std::size_t per_piece);

  std::size_t size() const { return (tasks_ + per_piece_ - 1) / per_piece_; }
  std::size_t of_task(std::size_t task) const { return task / per_piece_; }
  /// First task of a piece, and the first that is not its any more.
  std::pair<std::size_t, std::size_t> range(std::size_t piece) const;
  std::string name(std::size_t piece) const;

  /// @return nothing when nobody has finished it, or the file is damaged: it is then done again
  std::optional<std::vector<SourceOutcome>> read(std::size_t piece) const;
  void write(std::size_t piece, const std::vector<SourceOutcome>& outcomes) const;  ///< atomic

 private:
  std::filesystem::path file(std::size_t piece) const;

  std::filesystem::path folder_;
  std::string prefix_;
  std::size_t tasks_, per_piece_;
};

/// Folder of the files of all pieces.
std::filesystem::path pieces_folder(const std::filesystem::path& out);

}  // namespace anigen::prepare
