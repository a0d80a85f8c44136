#pragma once
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>

#include "anigen/geometry/nearest_surface.h"
#include "anigen/loaders/files/rig_arrays.h"

namespace anigen::loaders {

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

}  // namespace anigen::loaders
