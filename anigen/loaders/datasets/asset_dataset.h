#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/loaders/batch_source.h"
#include "anigen/loaders/broken_assets.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// What the published dataset classes have in common: assets whose files are read anew for every draw (their pictures
/// and features do not fit into memory), one sample per draw, samples collated into a batch.
///
/// The published loaders replace a sample that cannot be read by a random other one without counting it. Here it is an
/// error naming file and place. With skip_broken, assets with missing files are left out at the start, and one that
/// turns out broken later is replaced by an asset chosen by (seed, position), named in the log and counted.
class AssetDataset : public BatchSource {
 public:
  struct Options {
    std::uint64_t seed = 0;
    bool skip_broken = false;
    bool bucket_by_voxels = false;  ///< ours: batches of assets of similar size, see bucketed_order.h
  };

  /// Draws per epoch: assets, each as often as its AssetId::repeat says.
  std::size_t size() const override { return visits_.size(); }
  std::size_t assets() const { return assets_.size(); }
  const AssetId& asset(std::size_t index) const { return assets_[index]; }
  /// The first Draw::item that stands for an asset. @param asset below assets()
  std::size_t item_of(std::size_t asset) const;
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const final;
  std::vector<std::uint64_t> bucket_loads() const override;
  /// Assets found broken after the start: id → what is wrong.
  std::map<std::string, std::string> broken() const { return broken_.problems(); }

 protected:
  struct Sample {
    virtual ~Sample() = default;
    std::string id;
  };
  using Samples = std::vector<std::unique_ptr<Sample>>;

  /// How a class finds what it needs to know of its assets before training.
  struct Files {
    /// All files a sample is read from; an InputError that it throws is the asset's problem.
    std::function<std::vector<std::filesystem::path>(const AssetId&)> of;
    /// Number of voxels of an asset whose metadata does not say; null when the class does not balance by it.
    std::function<std::uint64_t(const AssetId&)> count_voxels;
  };

  /// @throws InputError naming the first assets with missing files and how many there are
  AssetDataset(std::vector<AssetId> assets, const Options& options, const Files& files);

  /// Random choices of a sample come from Rng(seed, a purpose, position). Called from several threads.
  virtual std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const = 0;
  /// @param samples not empty @param ids theirs
  virtual std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const = 0;

  std::uint64_t seed() const { return options_.seed; }
  std::uint64_t voxels_of_item(std::size_t item) const { return voxels_.empty() ? 0 : voxels_[visits_[item]]; }

 private:
  std::unique_ptr<Sample> sample(const Draw& draw) const;

  Options options_;
  std::vector<AssetId> assets_;
  std::vector<std::uint64_t> voxels_;  // [assets]; empty when Files::count_voxels is null
  std::vector<std::size_t> visits_;    // draw item → asset
  mutable BrokenAssets broken_;
};

}  // namespace anigen::loaders
