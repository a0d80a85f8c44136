#include "anigen/prepare/steps/skeleton_step.h"

#include <algorithm>

#include "anigen/io/gltf.h"
#include "anigen/prepare/skeleton_archive.h"

namespace anigen::prepare {

std::vector<std::filesystem::path> SkeletonStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.skeleton()};
}

Json SkeletonStep::run(AssetJob& job) const {
  write_skeleton_archive(job.places().skeleton(), job.asset());
  return Json::object();
}

std::vector<std::filesystem::path> KeepAssetStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.asset()};
}

Json KeepAssetStep::run(AssetJob& job) const {
  io::ExportOptions exported;
  exported.influences = std::max<std::size_t>(1, job.asset().skin.largest_row());
  io::write_gltf(job.places().asset(), job.asset(), exported);
  return Json::object();
}

}  // namespace anigen::prepare
