#pragma once
#include <torch/torch.h>
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/data/metadata.h"
#include "anigen/data/view_files.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::data {

/// Contents of `skeleton/<id>/skeleton_voxelized.npz`, in memory: docs/reference/training.md, 1.1. World frame, object
/// in [-0.5, 0.5]³. Skin weights are sparse: dense ones of a large set would not fit into memory.
struct RiggedItem {
  std::string id;
  std::vector<Eigen::Vector3f> joints;    ///< [J]
  std::vector<int> parents;               ///< [J], -1 for a root; no cycles, otherwise in any order
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;            ///< [F], F > 0
  SkinWeights skin;                       ///< [V] rows; an all-zero row has weight 1 on joint 0
  std::size_t unweighted = 0;             ///< those rows

  std::size_t bytes() const;  ///< memory it takes, about
};

/// Reads one asset. @throws InputError naming file, array and index: missing arrays, wrong shapes, numbers that are
/// not finite, negative weights, parents or faces out of range, cycles, more than max_joints joints
RiggedItem read_rigged_item(const AssetId& asset, std::size_t max_joints = 4096);

/// Joints so that parents come before children, ties by index. @throws InputError on a parent out of range or a
/// cycle @param file only for messages
std::vector<int> parents_first_order(const std::vector<int>& parents, const std::string& file);

/// Points as rows, [N, 3] fp32. Filled by the calling thread alone.
torch::Tensor points_tensor(const std::vector<Eigen::Vector3f>& points);

/// Returns the result of `make`; InputErrors without a file then name this one, or this asset.
template <typename Make>
auto naming(const std::string& file, Make make) -> decltype(make()) {
  try {
    return make();
  } catch (const InputError& error) {
    if (!error.file().empty()) throw;
    throw InputError(file, error.place(), error.problem());
  }
}

/// The rigged meshes of a batch, one entry per asset: they stay lists, since their sizes differ. World frame.
struct RigBatch {
  std::vector<torch::Tensor> joints;    ///< [J, 3] fp32
  std::vector<torch::Tensor> parents;   ///< [J] int32, -1 for a root
  std::vector<torch::Tensor> skin;      ///< [V, J] fp32
  std::vector<torch::Tensor> vertices;  ///< [V, 3] fp32
  std::vector<torch::Tensor> faces;     ///< [F, 3], int32 where the file has int32, else int64
  /// With `load_cubvh`: the nearest-surface solver of each mesh, shared between batches; otherwise empty.
  std::vector<std::shared_ptr<const geometry::NearestSurface>> surfaces;

  void append(const RigArrays& rig);
};

/// Nearest-surface solvers of meshes that were used lately, so that an epoch over a small dataset builds each once. It
/// takes the place of the published `cubvh.pth` files, which are ignored. Thread-safe; what it hands out stays valid
/// when the cache forgets it, and is the same whether it was kept or built again.
class SurfaceCache {
 public:
  /// @param budget bytes, estimated from the number of faces; what does not fit is built again when needed
  explicit SurfaceCache(std::uintmax_t budget) : budget_(budget) {}

  std::shared_ptr<const geometry::NearestSurface> of(std::size_t asset, const RigArrays& rig);

 private:
  struct Entry {
    std::size_t asset;
    std::uintmax_t bytes;
    std::shared_ptr<const geometry::NearestSurface> surface;
  };
  std::uintmax_t budget_, used_ = 0;
  std::mutex mutex_;
  std::list<Entry> entries_;  // used last first
  std::map<std::size_t, std::list<Entry>::iterator> places_;
};

/// Prepared assets as samples of a baseline's own kind, held in memory.
template <typename Sample>
struct ConvertedAssets {
  std::vector<Sample> samples;
  std::vector<std::size_t> repeat;                ///< how often an epoch visits each
  std::vector<std::string> unreadable, rejected;  ///< the others: what is wrong, with the id

  /// @param problem why the sample cannot be used; empty: it can
  void add(Sample sample, std::size_t times, const std::string& id, const std::string& problem) {
    if (!problem.empty()) {
      rejected.push_back(id + ": " + problem);
      return;
    }
    samples.push_back(std::move(sample));
    repeat.push_back(times);
  }

  /// Counts and names what was left out. @param purpose for messages, as in "left to train on"
  /// @throws InputError for unreadable ones unless skip_broken, and when nothing is left
  void report(bool skip_broken, const char* purpose) const {
    report_broken(unreadable, samples.size() + unreadable.size() + rejected.size(), skip_broken);
    for (const std::string& problem : rejected) log::debug("left out: {}", problem);
    if (!rejected.empty()) {
      log::info("{} of {} assets to {} left out, such as {}", rejected.size(), samples.size() + rejected.size(),
                purpose, rejected.front());
    }
    if (samples.empty()) throw InputError("", "dataset", std::string("there is nothing left to ") + purpose);
  }
};

/// Reads all assets and converts them, on all threads; the result is in the order of the assets.
/// @param convert Sample(const RiggedItem&), whose InputErrors reject the asset
/// @param problem std::string(const Sample&): why it cannot be used, or ""
template <typename Sample, typename Convert, typename Problem>
ConvertedAssets<Sample> convert_assets(const std::vector<AssetId>& assets, Convert convert, Problem problem) {
  struct Read {
    Sample sample;
    std::string unreadable, rejected;
  };
  std::vector<Read> read(assets.size());
  Progress progress("converting rigs", assets.size(), "assets");
  parallel_for(assets.size(), [&](std::size_t i) {
    RiggedItem item;
    try {
      item = read_rigged_item(assets[i]);
    } catch (const InputError& error) {
      read[i].unreadable = error.what();
      return;
    }
    try {
      read[i].sample = convert(item);
    } catch (const InputError& error) {
      read[i].rejected = error.what();
    }
    progress.advance();
  });
  progress.finish();
  ConvertedAssets<Sample> all;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    if (!read[i].unreadable.empty()) {
      all.unreadable.push_back(read[i].unreadable);
    } else if (!read[i].rejected.empty()) {
      all.rejected.push_back(read[i].rejected);
    } else {
      const std::string why = problem(read[i].sample);
      all.add(std::move(read[i].sample), assets[i].repeat, assets[i].id, why);
    }
  }
  return all;
}

}  // namespace anigen::data
