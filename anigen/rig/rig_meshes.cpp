#include "anigen/rig/rig_meshes.h"

#include <chrono>
#include <cstdio>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/geometry/bone_segments.h"
#include "anigen/io/gltf.h"
#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/split.h"

namespace anigen::rig {
namespace {

namespace fs = std::filesystem;

Box box_of(const io::RiggedShape& shape) { return bounding_box(shape.mesh.vertices); }

/// Ids may hold folders, and come from files that somebody else wrote. @throws InputError for one that leaves `out`
fs::path file_of(const RigRequest& request, const io::ShapeSource& source, const std::string& id) {
  if (source.is_single_file()) return request.out;
  const fs::path below = id;
  bool leaves = below.empty() || below.is_absolute();
  for (const fs::path& part : below) leaves = leaves || part == ".." || part.empty();
  if (leaves) throw InputError(source.describe(), "", "the id \"" + id + "\" names no file below a folder");
  return request.out / (id + ".glb");
}

}  // namespace

std::vector<BoxedSkeleton> skeletons_of(const fs::path& collection, const std::vector<fs::path>& splits) {
  const auto source = io::open_source(collection);
  std::vector<BoxedSkeleton> skeletons;
  std::size_t left_out = 0;
  const std::vector<std::string> ids = io::select_ids(*source, splits);
  Progress progress("reading skeletons", ids.size(), "assets");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    progress.advance();
    if (!source->is_usable(id)) continue;
    try {
      const io::RiggedShape shape = source->read(id);
      skeletons.push_back(boxed_skeleton(id, shape.joints.positions, shape.joints.parents, box_of(shape)));
    } catch (const InputError& error) {
      ++left_out;
      log::debug("{}", error.what());
    }
  }
  progress.finish();
  if (skeletons.empty()) throw InputError(collection.string(), "", "holds no skeleton with a mesh that could be used");
  if (left_out > 0) log::info("{} assets of {} have no usable skeleton", left_out, collection.string());
  return skeletons;
}

Asset rig_by_template(const io::RiggedShape& shape, const BoxedSkeleton& skeleton) {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  io::RiggedShape rigged;
  rigged.id = shape.id;
  rigged.file = shape.file;
  rigged.mesh = shape.mesh;
  rigged.materials = shape.materials;
  rigged.images = shape.images;
  rigged.joints.positions = placed_joints(skeleton, box_of(shape));
  rigged.joints.parents = skeleton.parents;
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& joint : rigged.joints.positions) joints.push_back(joint.cast<float>());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  for (const std::size_t joint : geometry::nearest_moving_joints(shape.mesh.vertices, segments)) {
    rigged.skin.append_row({{static_cast<std::int32_t>(joint), 1.0F}});
  }
  return io::to_asset(rigged);
}

RigReports rig_meshes(const RigRequest& request) {
  const auto source = io::open_source(request.meshes);
  const std::vector<BoxedSkeleton> skeletons = skeletons_of(request.skeletons, request.splits);
  const BoxedSkeleton& skeleton = skeletons[medoid(skeletons)];
  RigReports reports;
  reports.skeleton = skeleton.id;
  const std::vector<std::string> ids = source->ids();
  Progress progress("rigging", ids.size(), "meshes");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    const auto started = std::chrono::steady_clock::now();
    RigReport report;
    report.id = id;
    try {
      report.file = file_of(request, *source, id);
      const Asset asset = rig_by_template(source->read(id), skeleton);
      io::write_gltf(report.file, asset);
      report.joints = asset.skeleton.size();
      report.vertices = asset.mesh.vertices.size();
    } catch (const InputError& error) {
      report.failure = error.what();
      log::warn("{}: {}", id, error.what());
    }
    report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    reports.meshes.push_back(std::move(report));
    progress.advance();
  }
  progress.finish();
  return reports;
}

Json to_json(const RigReports& reports) {
  Json list = Json::array();
  for (const RigReport& report : reports.meshes) {
    Json one = {{"id", report.id}, {"file", report.file.string()}, {"seconds", report.seconds}};
    if (report.failure.empty()) {
      one["joints"] = report.joints;
      one["vertices"] = report.vertices;
    } else {
      one["failure"] = report.failure;
    }
    list.push_back(std::move(one));
  }
  return {{"template", reports.skeleton}, {"meshes", std::move(list)}};
}

std::string to_text(const RigReports& reports) {
  std::string text = "template: the skeleton of " + reports.skeleton + "\n";
  for (const RigReport& report : reports.meshes) {
    text += report.id + ": ";
    if (!report.failure.empty()) {
      text += report.failure + "\n";
      continue;
    }
    char line[96];
    std::snprintf(line, sizeof line, ", %zu joints, %zu vertices, %.2f s\n", report.joints, report.vertices,
                  report.seconds);
    text += report.file.string() + line;
  }
  return text;
}

}  // namespace anigen::rig
