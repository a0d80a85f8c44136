#pragma once
#include <torch/torch.h>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/batches.h"
#include "anigen/data/datasets.h"
#include "anigen/data/metadata.h"
#include "anigen/rigging/skin_features.h"

namespace anigen::data {

/// Part of the real rigs of a dataset that is held out, "i/n" with i from 0 to n − 1; the other parts are trained on.
struct SkeletonFold {
  std::size_t index = 0, count = 1;

  /// @throws InputError(file, place) for another text, n below 2 or i not below n
  static SkeletonFold parse(const std::string& text, const std::string& file = "", const std::string& place = "");
  /// By a hash of the joint tree (tree_signature()), so that rigs of one tree are held out together and the part of a
  /// rig does not depend on what else a dataset holds.
  bool holds(const std::string& signature) const;
};

/// Signature of the joint tree of a prepared asset, as `anigen-prepare --split-by skeleton` compares trees. Reads
/// nothing but the tree. @throws InputError naming the file
std::string skeleton_signature_of(const AssetId& asset);

/// True unless the column `source` says "procedural:…".
bool is_real(const AssetId& asset);

/// `dataset.args` of AniGenSkinCorrections, ours. Rows may lack voxels, views and features.
struct SkinCorrectionDataOptions {
  SourceOptions sources;
  rigging::SkinFeatureOptions features;  ///< `candidates`, `geovoxel_resolution`
  std::size_t cached_vertices = 1024;    ///< vertices of an asset whose features are kept; 0: all
  std::size_t vertices = 128;            ///< of a sample, drawn from those
  std::optional<double> real_share;      ///< of the samples that are of real rigs, where there are both; unset: any
  bool even_skeletons = false;           ///< with real_share: each joint tree of real rigs as often as any other
  std::string fold;            ///< SkeletonFold of the real rigs, whatever the splits say of them; empty: none
  bool bad_skeletons = false;  ///< also rigs with `is_bad_skeleton`, in which bones coincide, for example
  std::filesystem::path cache = "skin_features";  ///< folder of features, below the root of an asset unless absolute
  double drop_classical = 0.1;  ///< chance that a sample sees no weights by heat, or none by geodesic voxels

  /// @throws InputError
  static SkinCorrectionDataOptions read(ConfigReader& reader);
};

/// Vertices of some assets with the features of their candidates.
struct SkinCorrectionBatch : Batch {
  torch::Tensor pairs;    ///< [N, K, rigging::kSkinPairFeatures] fp32
  torch::Tensor assets;   ///< [N, rigging::kSkinAssetFeatures] fp32
  torch::Tensor present;  ///< [N, K] bool: there is such a candidate
  torch::Tensor truth;    ///< [N, K] fp32, true weights of the candidates
  torch::Tensor missed;   ///< [N] fp32, true weight of joints that are no candidates; the row sums to 1 with it
};

/// AniGenSkinCorrections: vertices of an asset, uniformly from its vertex list, with the features of their candidate
/// joints (rigging/skin_features.h); what a network learns that corrects classical weights. Features are computed once,
/// several assets at a time, and kept as files of 16-bit numbers, `<cache>/<id>.npz`, written by rename: an interrupted
/// run goes on, and several may share a folder. A file is made again when the version of the features, an option that
/// it depends on, or the length of the rig's file has changed.
class SkinCorrectionDataset : public BatchSource {
 public:
  /// @param training whether samples are changed at random, and `real_share` counts
  /// @throws InputError for assets that cannot be read or bound, unless skip_broken; WriteError when the disk refuses
  SkinCorrectionDataset(std::vector<AssetId> assets, const SkinCorrectionDataOptions& options, std::uint64_t seed,
                        bool training);
  ~SkinCorrectionDataset() override;

  std::size_t size() const override { return visits_.size(); }
  std::size_t assets() const { return assets_.size(); }
  const AssetId& asset(std::size_t index) const { return assets_[index]; }
  const SkinCorrectionDataOptions& options() const { return options_; }
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const override;
  /// All kept vertices of an asset, unchanged.
  std::unique_ptr<SkinCorrectionBatch> all_of(std::size_t asset) const;

 private:
  struct Example;
  void read_all(std::vector<AssetId> assets);
  void arrange_visits(bool training);
  std::vector<std::size_t> evenly_by_skeleton(const std::vector<std::size_t>& real) const;
  void share_visits(const std::vector<std::size_t>& real, const std::vector<std::size_t>& drawn, double share);
  std::unique_ptr<SkinCorrectionBatch> batch_of(std::size_t rows) const;
  void put(const Example& example, const std::vector<std::size_t>& rows, std::size_t first,
           SkinCorrectionBatch& batch) const;

  SkinCorrectionDataOptions options_;
  std::uint64_t seed_;
  bool training_;
  std::vector<AssetId> assets_;
  std::vector<std::shared_ptr<const Example>> examples_;  // [assets]
  std::vector<std::size_t> visits_;                       // draw item → asset
};

/// Both datasets of a config. With a fold real rigs come from all of the dataset: those of the fold are held out,
/// alone, and the others are trained on beside the creatures of the split. @throws InputError as make_datasets()
Datasets open_skin_corrections(ConfigReader& args, std::uint64_t seed);

}  // namespace anigen::data
