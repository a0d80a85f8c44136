#include "anigen/loaders/datasets/asset_dataset.h"

#include <algorithm>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

constexpr int kReplacements = 20;

// Only whether files are there: reading all of a large dataset would take hours.
std::string missing_file(const std::vector<fs::path>& files) {
  for (const fs::path& file : files) {
    std::error_code error;
    if (!fs::is_regular_file(file, error)) return InputError(file.string(), "", "no such file").what();
  }
  return "";
}

}  // namespace

AssetDataset::AssetDataset(std::vector<AssetId> assets, const Options& options, const Files& files)
    : options_(options) {
  std::vector<std::string> problems(assets.size());
  std::vector<std::uint64_t> voxels(assets.size(), 0);
  parallel_for(assets.size(), [&](std::size_t i) {
    try {
      problems[i] = missing_file(files.of(assets[i]));
      if (!problems[i].empty() || !files.count_voxels) return;
      voxels[i] = assets[i].num_voxels > 0 ? assets[i].num_voxels : files.count_voxels(assets[i]);
    } catch (const InputError& error) {
      problems[i] = error.what();
    }
  });
  std::vector<std::string> named;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    if (!problems[i].empty()) {
      named.push_back(problems[i]);
      continue;
    }
    visits_.insert(visits_.end(), assets[i].repeat, assets_.size());
    assets_.push_back(std::move(assets[i]));
    if (files.count_voxels) voxels_.push_back(voxels[i]);
  }
  report_broken(named, problems.size(), options.skip_broken);
}

std::size_t AssetDataset::item_of(std::size_t asset) const {
  // The visits of an asset follow each other, in the order of assets.
  return static_cast<std::size_t>(std::lower_bound(visits_.begin(), visits_.end(), asset) - visits_.begin());
}

std::unique_ptr<Batch> AssetDataset::load(const std::vector<Draw>& draws) const {
  Samples samples;
  std::vector<std::string> ids;
  for (const Draw& draw : draws) {
    samples.push_back(sample(draw));
    ids.push_back(samples.back()->id);
  }
  std::unique_ptr<Batch> batch = collate(samples, ids);
  batch->ids = std::move(ids);
  return batch;
}

std::unique_ptr<AssetDataset::Sample> AssetDataset::sample(const Draw& draw) const {
  std::size_t asset = visits_[draw.item];
  Rng replacement(options_.seed, "replacement", draw.position);
  for (int attempt = 0;; ++attempt) {
    try {
      std::unique_ptr<Sample> found = read(asset, draw.position);
      found->id = assets_[asset].id;
      return found;
    } catch (const InputError& error) {
      if (!options_.skip_broken) throw;
      broken_.note(assets_[asset].id, error.what());
      if (attempt == kReplacements) {
        throw InputError("", "dataset",
                         std::to_string(broken_.count()) + " assets cannot be read, the last " +
                             std::to_string(kReplacements + 1) + " in a row; the last error: " + error.what());
      }
      asset = visits_[replacement.index(visits_.size())];
    }
  }
}

std::vector<std::uint64_t> AssetDataset::bucket_loads() const {
  std::vector<std::uint64_t> loads;
  if (!options_.bucket_by_voxels) return loads;
  for (std::size_t item = 0; item < visits_.size(); ++item) loads.push_back(voxels_of_item(item));
  return loads;
}

}  // namespace anigen::loaders
