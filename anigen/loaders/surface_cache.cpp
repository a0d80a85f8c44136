#include "anigen/loaders/surface_cache.h"

#include <utility>

namespace anigen::loaders {
namespace {

constexpr std::uintmax_t kBytesPerFace = 300, kBytesPerVertex = 24;  // of a BVH with its copy of the mesh, about

}  // namespace

std::shared_ptr<const geometry::NearestSurface> SurfaceCache::of(std::size_t asset, const RigArrays& rig) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = places_.find(asset); found != places_.end()) {
      entries_.splice(entries_.begin(), entries_, found->second);
      return found->second->surface;
    }
  }
  auto surface = std::make_shared<const geometry::NearestSurface>(rig.vertices, rig.faces);
  const std::uintmax_t bytes = kBytesPerFace * rig.faces.size() + kBytesPerVertex * rig.vertices.size();
  const std::lock_guard<std::mutex> lock(mutex_);
  // Another thread may have built the same one meanwhile.
  if (bytes > budget_ || places_.count(asset) > 0) return surface;
  while (used_ + bytes > budget_) {
    used_ -= entries_.back().bytes;
    places_.erase(entries_.back().asset);
    entries_.pop_back();
  }
  entries_.push_front({asset, bytes, surface});
  places_[asset] = entries_.begin();
  used_ += bytes;
  return surface;
}

}  // namespace anigen::loaders
