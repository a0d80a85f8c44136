#pragma once
#include <torch/torch.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/loaders/augment.h"
#include "anigen/loaders/batch_source.h"
#include "anigen/loaders/metadata.h"
#include "anigen/loaders/rigged_item.h"
#include "anigen/loaders/skin_sampler.h"

namespace anigen::loaders {

/// What the skin auto-encoder trains on: per asset a skeleton and skin weights at points of the surface.
struct SkinBatch : Batch {
  std::vector<torch::Tensor> joints;   ///< per asset [J, 3] fp32, world frame
  std::vector<torch::Tensor> parents;  ///< per asset [J] int64, -1 for a root
  std::vector<torch::Tensor> skin;     ///< per asset [n, J] fp32, rows sum to 1
};

/// Reads rigs from disk once, keeps them in memory as sparse rows, and draws augmented samples from them (paper 3.3.1;
/// reference training-and-data.md, 3.1).
class SkinDataset : public BatchSource {
 public:
  struct Options {
    std::uint64_t seed = 0;
    std::int64_t num_skin_samples = 4096;  ///< points per asset and draw; 0: all vertices instead of points
    Augmentations augmentations;
    bool skip_broken = false;  ///< leave out assets that cannot be read, counted and named in the log
    std::uintmax_t memory_budget = std::uintmax_t{8} << 30;  ///< bytes; what does not fit is read again when drawn
  };

  /// Reads assets until the budget is used. @throws InputError naming the first broken assets and how many there are
  SkinDataset(std::vector<AssetId> assets, const Options& options);

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

}  // namespace anigen::loaders
