#include "anigen/rig/rig_meshes.h"

#include <chrono>
#include <cstdio>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/core/version.h"
#include "anigen/geometry/skeleton_mesh.h"
#include "anigen/io/gltf.h"
#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/split.h"

namespace anigen::rig {
namespace {

namespace fs = std::filesystem;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Ids may hold folders, and come from files that somebody else wrote.
bool names_file_below(const std::string& id) {
  const fs::path below = id;
  bool leaves = below.empty() || below.is_absolute();
  for (const fs::path& part : below) leaves = leaves || part == ".." || part.empty();
  return !leaves;
}

/// @throws InputError for an id that leaves `out`
fs::path file_of(const RigRequest& request, const io::ShapeSource& source, const std::string& id) {
  if (source.is_single_file()) return request.out;
  if (!names_file_below(id))
    throw InputError(source.describe(), "", "the id \"" + id + "\" names no file below a folder");
  return request.out / (id + ".glb");
}

/// Everything that is read for these meshes.
std::vector<fs::path> inputs_of(const RigRequest& request, const io::ShapeSource& source,
                                const std::vector<std::string>& ids) {
  std::vector<fs::path> inputs = request.also_read;
  const auto add = [&inputs](const std::vector<fs::path>& files) {
    inputs.insert(inputs.end(), files.begin(), files.end());
  };
  const auto add_shapes = [&](const io::ShapeSource& shapes, const std::vector<std::string>& read) {
    for (const std::string& id : read) add(shapes.files(id));
  };
  add(request.splits);
  add(request.joints.splits);
  add_shapes(source, ids);
  for (const fs::path& other : {request.joints.skeleton, request.joints.collection}) {
    if (other.empty()) continue;
    const auto shapes = io::open_source(other);
    add_shapes(*shapes, shapes->ids());
  }
  return inputs;
}

void refuse_lossy_outputs(const RigRequest& request, const io::ShapeSource& source,
                          const std::vector<std::string>& ids) {
  std::vector<fs::path> outputs;
  for (const std::string& id : ids) {
    if (!source.is_single_file() && !names_file_below(id)) continue;
    outputs.push_back(file_of(request, source, id));
    if (!request.also_writes.empty())
      outputs.push_back(fs::path(outputs.back()).replace_extension(request.also_writes));
  }
  refuse_to_overwrite(outputs, [&] { return inputs_of(request, source, ids); });
}

/// The shape with these joints and no weights yet.
Asset unbound_asset(const io::RiggedShape& shape, const Skeleton& joints) {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.materials = shape.materials;
  asset.images = shape.images;
  asset.skeleton = joints;
  return asset;
}

Asset rigged(const io::RiggedShape& shape, const JointProposer& proposer, const RigRequest& request,
             RigReport& report) {
  const auto started = std::chrono::steady_clock::now();
  const LearnedSteps& learned = request.learned;
  ProposedJoints proposed = learned.propose ? learned.propose(shape, proposer) : proposer.propose(shape);
  report.note = std::move(proposed.note);
  report.joint_seconds = seconds_since(started);
  if (!request.method.binding) {
    Asset solid = geometry::skeleton_asset(proposed.skeleton);
    solid.name = shape.id;
    return solid;
  }
  const auto found = std::chrono::steady_clock::now();
  Asset asset = unbound_asset(shape, proposed.skeleton);
  asset.skin = learned.bind ? learned.bind(shape, asset.skeleton)
                            : bind(*request.method.binding, asset.mesh, asset.skeleton, request.binding);
  report.binding_seconds = seconds_since(found);
  return asset;
}

}  // namespace

Asset bound_asset(const io::RiggedShape& shape, const Skeleton& joints, SkinBinding binding,
                  const BindingOptions& options) {
  Asset asset = unbound_asset(shape, joints);
  asset.skin = bind(binding, asset.mesh, asset.skeleton, options);
  return asset;
}

RigReports rig_meshes(const RigRequest& request) {
  const auto source = io::open_meshes(request.meshes, {request.axes, false});
  const std::vector<std::string> ids = io::select_ids(*source, request.splits);
  refuse_lossy_outputs(request, *source, ids);
  const JointProposer proposer(request.method.joints, request.joints);
  RigReports reports;
  reports.skeleton = proposer.template_id();
  Progress progress("rigging", ids.size(), "meshes");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    const auto started = std::chrono::steady_clock::now();
    RigReport report;
    report.id = id;
    try {
      report.file = file_of(request, *source, id);
      const Asset asset = rigged(source->read(id), proposer, request, report);
      io::write_gltf(report.file, asset);
      report.joints = asset.skeleton.size();
      report.vertices = asset.mesh.vertices.size();
      if (request.also) request.also(asset, report.file);
    } catch (...) {
      report.failure = failure_of_item();
      log::warn("{}: {}", id, report.failure);
    }
    report.seconds = seconds_since(started);
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
      one["joint_seconds"] = report.joint_seconds;
      one["binding_seconds"] = report.binding_seconds;
      if (!report.note.empty()) one["note"] = report.note;
    } else {
      one["failure"] = report.failure;
    }
    list.push_back(std::move(one));
  }
  Json json = {{"version", kVersion}, {"commit", commit()}, {"meshes", std::move(list)}};
  if (!reports.skeleton.empty()) json["template"] = reports.skeleton;
  return json;
}

std::string to_text(const RigReports& reports) {
  std::string text;
  if (!reports.skeleton.empty()) text = "template: the skeleton of " + reports.skeleton + "\n";
  for (const RigReport& report : reports.meshes) {
    text += report.id + ": ";
    if (!report.failure.empty()) {
      text += report.failure + "\n";
      continue;
    }
    char line[96];
    std::snprintf(line, sizeof line, ", %zu joints, %zu vertices, %.2f s", report.joints, report.vertices,
                  report.seconds);
    text += report.file.string() + line + (report.note.empty() ? "" : ", " + report.note) + "\n";
  }
  return text;
}

}  // namespace anigen::rig
