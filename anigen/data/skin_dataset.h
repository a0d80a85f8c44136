#pragma once
#include <torch/torch.h>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/random.h"
#include "anigen/data/augment.h"
#include "anigen/data/batches.h"
#include "anigen/data/metadata.h"
#include "anigen/data/rigged_item.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::data {

/// `dataset.args` of AniGenSparseFeat2Skeleton as far as the skin auto-encoder needs them (docs/reference/training.md,
/// 1.3). The arguments about images, features and voxels are accepted and not used: the published class loads those
/// files and its first stage never looks at them.
struct SkinDatasetOptions : SourceOptions {
  std::int64_t memory_budget_mb = 8192;  ///< ours: assets kept in memory

  /// @throws InputError; NotSupportedError for skin_accum_as_flow
  static SkinDatasetOptions read(ConfigReader& reader);
};

/// Draws points on the surface of one asset, and the skin weights there. Set up once, drawn from at every step.
class SkinSampler {
 public:
  /// @param with_blends also prepares draw() with blend_share > 0
  SkinSampler(const RiggedItem& item, bool with_blends);

  /// One point: uniform over the surface (docs/reference/training.md, 3.1), or, with probability blend_share, with a
  /// density proportional to how blended the skin of its face is: 1 − the largest weight at its middle.
  geometry::SurfacePoint draw(double blend_share, Rng& rng) const;

  std::size_t bytes() const { return (areas_.size() + blends_.size()) * sizeof(double); }

 private:
  std::vector<double> areas_, blends_;  // [F] running sums of probability; blends_ empty when nothing is blended
};

/// Adds the barycentric mean of the three vertices' weights to out. @param joint_of where each joint of the asset
/// goes @param out [joints after that map], set to zero by the caller
void add_weights_at(const RiggedItem& item, const geometry::SurfacePoint& point, const std::vector<int>& joint_of,
                    float* out);

/// Training data of the skin auto-encoder: per asset a skeleton and skin weights at points of the surface.
struct SkinBatch : Batch {
  std::vector<torch::Tensor> joints;   ///< per asset [J, 3] fp32, world frame
  std::vector<torch::Tensor> parents;  ///< per asset [J] int64, -1 for a root
  std::vector<torch::Tensor> skin;     ///< per asset [n, J] fp32, rows sum to 1
};

/// Reads rigs from disk once, keeps them in memory as sparse rows, and draws augmented samples from them (paper 3.3.1;
/// docs/reference/training.md, 3.1).
class SkinDataset : public BatchSource {
 public:
  struct Options {
    std::uint64_t seed = 0;
    std::int64_t num_skin_samples = 4096;  ///< points per asset and draw; 0: all vertices instead of points
    Augmentations augmentations;
    bool skip_broken = false;  ///< leave out assets that cannot be read, counted and named in the log
    std::uintmax_t memory_budget = std::uintmax_t{8} << 30;  ///< bytes; what does not fit is read again when drawn
  };

  /// Reads assets until the budget is used. @param earlier assets that it has read are not read again; or null
  /// @throws InputError naming the first broken assets and how many there are
  SkinDataset(std::vector<AssetId> assets, const Options& options, const SkinDataset* earlier = nullptr);

  /// Draws per epoch: assets, each as often as its AssetId::repeat says.
  std::size_t size() const override { return visits_.size(); }
  std::size_t assets() const { return assets_.size(); }
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const override;

  const std::string& id(std::size_t item) const { return assets_[item].id; }
  /// The asset as stored, from memory or from disk.
  std::shared_ptr<const RiggedItem> item(std::size_t index) const;
  /// Unaugmented weights of up to `most` vertices, evenly spread over the vertex list; 0: of all. For evaluation.
  std::unique_ptr<SkinBatch> vertices_of(std::size_t index, std::size_t most) const;

 private:
  struct Entry;
  std::shared_ptr<const Entry> entry(std::size_t index) const;
  void sample(std::size_t index, std::uint64_t position, SkinBatch& batch) const;

  std::vector<AssetId> assets_;
  std::vector<std::size_t> visits_;  // draw item → asset
  Options options_;
  std::vector<std::shared_ptr<const Entry>> entries_;  // null: read when drawn
};

}  // namespace anigen::data
