#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/asset_source.h"
#include "anigen/prepare/skeleton_checks.h"

namespace anigen::prepare {

struct PrepareOptions {
  std::filesystem::path out;
  std::vector<AssetSource> sources;
  std::uint64_t seed = 0;                 ///< of the split
  double test_fraction = 0.333;           ///< of the usable real assets
  std::optional<std::size_t> test_count;  ///< of the usable real assets, instead of the fraction
  std::size_t procedural_test = 0;        ///< of the usable procedural assets
  QualityLimits limits;
  bool keep_assets = true;  ///< also write assets/<id>.glb
};

struct Rejected {
  std::string file_identifier;
  std::string reason;
};

struct PrepareSummary {
  std::size_t real = 0, procedural = 0, reused = 0;
  std::size_t bad_skeleton = 0, bad_skin = 0, train = 0, test = 0;
  std::vector<Rejected> rejected;

  std::size_t prepared() const { return real + procedural; }
};

/// Writes the sources as a dataset in the published layout, as far as the first stage reads it (reference
/// training-and-data.md, 1.1):
///
///     metadata.csv  rejected.csv  splits/{train,test,unusable}.txt
///     skeleton/<id>/skeleton_voxelized.npz  assets/<id>.glb  records/<id>.json
///
/// Works on several assets at once; rows keep the order of the sources. What exists already for the same content
/// and the same version of this program is not made again, so an interrupted call can be repeated. metadata.csv
/// names exactly the sources of this call. A source that cannot be used, or that repeats an earlier one, goes to
/// rejected.csv. Only usable assets enter the splits; real ones that are not usable are listed in unusable.txt.
/// @throws InputError when not one source could be used, Interrupted after Ctrl-C, Error when the disk refuses
PrepareSummary prepare_dataset(const PrepareOptions& options);

Json to_json(const PrepareSummary& summary);
/// A few lines for the screen.
std::string to_text(const PrepareSummary& summary);

}  // namespace anigen::prepare
