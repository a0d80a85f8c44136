#include "anigen/engine/rig.h"

#include <chrono>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/rigging/write_rig.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;

rigging::SureJoints sure_joints() {
#ifdef ANIGEN_WITH_TORCH
  // Loaded for the first mesh that asks.
  return [](const io::RiggedShape& shape, std::string& why_not) {
    return engine_module("learned joints").sure_joints()(shape, why_not);
  };
#else
  return {};
#endif
}

rigging::RigRequest request_of(const RigOptions& options) {
  rigging::RigRequest request;
  request.method = rigging::parse_rigging_method(options.method, options.skin);
  if (request.method.joints == rigging::JointSource::kTemplate)
    throw NotSupportedError("", "method", "the template of a collection outside anigen-rig");
  if (!request.method.binding) throw InputError("", "skin", "\"none\" gives no weights");
  if (options.rigid_share != 0.0) {
    require_between(options.rigid_share, 0.5, 1.0, "rigid_share");
    request.rigid_share = options.rigid_share;
  }
  if (options.height != 0.0) require_between(options.height, 1e-9, 1e5, "height");
  request.joints.templates = options.templates;
  request.joints.keep_skeleton = options.keep_skeleton;
  request.separate_bodies = options.separate_bodies;
  request.edits = {options.joints, options.symmetric, options.add_joints};
  request.influences = request.binding.geodesic.most_influences = request.binding.heat.most_influences =
      options.influences;
  if (!options.bone_axes.empty()) request.engine.axes = rigging::parse_bone_axes(options.bone_axes);
  if (!options.names.empty()) request.engine.names = rigging::parse_name_style(options.names);
  request.engine.height = options.height;
  request.engine.ground = options.ground;
  request.engine.root_bone = options.root_bone;
  if (request.method.joints == rigging::JointSource::kAuto && options.learned_joints)
    request.joints.learned = sure_joints();
  return request;
}

void fit_to_engine(const rigging::RigRequest& request, Asset& asset, rigging::RigReport& report) {
  if (!request.engine.any()) return;
  const rigging::EngineRig rig =
      rigging::engine_rig(asset.skeleton, bounding_box(asset.mesh.vertices),
                          rigging::weight_of_joints(asset.skin, asset.skeleton.size()), request.engine, asset.name);
  rigging::add_note(rig.note, report);
  rigging::apply(rig, asset);
  asset.skeleton = rigging::oriented(rig, request.engine);
}

}  // namespace

Rigged rig(const Asset& mesh, const RigOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  const auto started = std::chrono::steady_clock::now();
  rigging::RigRequest request = request_of(options);
  const rigging::JointProposer proposer(request.method.joints, request.joints);
  const std::string name = mesh.name.empty() ? "mesh" : mesh.name;
  const io::RiggedShape shape = io::rigged_shape(mesh, name, name);
  rigging::RigReport report;
  Rigged rigged;
  if (job != nullptr) job->report("rigging", 0.0);
  rigged.asset = rigging::rig_shape(shape, proposer, request, report);
  throw_if_interrupted();
  if (request.engine.any()) {
    fit_to_engine(request, rigged.asset, report);
  } else {
    rigging::add_own_clips(shape, rigged.asset);
  }
  if (job != nullptr) job->report("rigging", 1.0);
  rigged.note = report.note;
  rigged.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return rigged;
}

std::string rig_file(const fs::path& from, const fs::path& to, const RigOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  rigging::RigRequest request = request_of(options);
  request.meshes = from;
  request.out = to;
  request.engine.humanoid = io::has_extension(to, {".vrm"});
  const rigging::RigReports reports = rigging::rig_meshes(request);
  const rigging::RigReport& report = reports.meshes.at(0);
  if (!report.failure.empty()) throw InputError("", "", report.failure);
  return report.note;
}

std::vector<std::string> template_words() { return rigging::template_words(); }

}  // namespace anigen::engine
