#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/run/dataset_rows.h"

namespace anigen::prepare {

/// How usable assets are divided. Variants follow their source: those of a test asset are never trained on.
struct SplitOptions {
  std::uint64_t seed = 0;
  /// Of the usable real assets. Without this and without a count, a source that brings its own test flags keeps them,
  /// and 0.333 holds where none does.
  std::optional<double> test_fraction;
  std::optional<std::size_t> test_count;  ///< of the usable real assets
  std::size_t procedural_test = 0;        ///< of the usable procedural assets
  /// Names of all test assets, real and procedural: uuid, sha256, path or "<shard>#<uuid>" (io::NameIndex). Not empty:
  /// the three numbers above and the sources' own flags do not count.
  std::vector<std::string> test_names;

  /// @throws InputError for a fraction outside [0, 1]
  void validate() const;
};
Json to_json(const SplitOptions& options);
SplitOptions split_options_from_json(const Json& json);

struct SplitCounts {
  std::size_t train = 0, test = 0, unusable = 0;
};

/// Sets is_test of every row. Warns of test_names that no asset has. @throws InputError when more are asked for than
/// are usable, no asset has one of test_names, or several could be meant by one
void mark_test(std::vector<DatasetRow>& rows, const SplitOptions& options, const QualityLimits& limits);

/// splits/train.txt, test.txt, test_variants.txt and unusable.txt: ids, one a line. Atomic.
SplitCounts write_splits(const std::filesystem::path& out, const std::vector<DatasetRow>& rows,
                         const QualityLimits& limits);

}  // namespace anigen::prepare
