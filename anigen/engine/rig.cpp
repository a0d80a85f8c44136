#include "anigen/engine/rig.h"

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/engine/option_names.h"
#include "anigen/engine/rig_request.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/rigging/write_rig.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;

constexpr OptionName kRigNames[] = {
    {"--method", "method"},         {"--skin", "skin"},           {"--template", "templates"},
    {"--add-joints", "add_joints"}, {"--bone-axes", "bone_axes"}, {"--names", "names"},
    {"--height", "height"},         {"--output", "to"},           {"--no-graft", "save() of rig()"}};

rigging::RigRequest checked_request(const RigOptions& options, rigging::RigRequest further = {}) {
  rigging::RigRequest request = rig_request(options, std::move(further));
  if (request.method.joints == rigging::JointSource::kTemplate)
    throw NotSupportedError("", "method", "the template of a collection outside anigen-rig");
  if (!request.method.binding) throw InputError("", "skin", "\"none\" gives no weights");
  if (options.rigid_share != 0.0) require_between(options.rigid_share, 0.5, 1.0, "rigid_share");
  constexpr double kMostJoints = 1000;  // as the program allows
  require_between(static_cast<double>(options.joints), 0, kMostJoints, "joints");
  if (options.height != 0.0) require_between(options.height, 1e-9, 1e5, "height");
  return request;
}

/// Joints as an engine wants them, with the clips that the mesh's own bring along.
void finish_joints(const rigging::RigRequest& request, const io::RiggedShape& shape, Asset& asset,
                   rigging::RigReport& report) {
  const Skeleton given = asset.skeleton;
  std::vector<std::string> names = given.names;
  if (request.engine.any()) {
    const rigging::EngineRig rig =
        rigging::engine_rig(given, bounding_box(asset.mesh.vertices),
                            rigging::weight_of_joints(asset.skin, given.size()), request.engine, asset.name);
    rigging::add_note(rig.note, report);
    rigging::apply(rig, asset);
    asset.skeleton = rigging::oriented(rig, request.engine);
    names = rigging::names_before(rig, given);
  }
  rigging::add_own_clips(shape, names, asset, report);
}

Rigged rigged(const Asset& mesh, const rigging::RigRequest& request, Job* job) {
  const auto started = std::chrono::steady_clock::now();
  const rigging::JointProposer proposer(request.method.joints, request.joints);
  const std::string name = mesh.name.empty() ? "mesh" : mesh.name;
  const io::RiggedShape shape = io::rigged_shape(mesh, name, name);
  rigging::RigReport report;
  Rigged result;
  if (job != nullptr) job->report("rigging", 0.0);
  result.asset = rigging::rig_shape(shape, proposer, request, report);
  throw_if_interrupted();
  finish_joints(request, shape, result.asset, report);
  if (job != nullptr) job->report("rigging", 1.0);
  result.note = report.note;
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return result;
}

}  // namespace

Rigged rig(const Asset& mesh, const RigOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  return with_library_words(kRigNames, [&] { return rigged(mesh, checked_request(options), job); });
}

std::string rig_file(const fs::path& from, const fs::path& to, const RigOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  return with_library_words(kRigNames, [&] {
    if (fs::is_directory(from)) throw InputError(from.string(), "from", "is a folder; rig_file() rigs one file");
    rigging::RigRequest further;
    further.meshes = from;
    further.out = to;
    further.engine.humanoid = io::has_extension(to, {".vrm"});
    const rigging::RigRequest request = checked_request(options, std::move(further));
    const rigging::RigReports reports = rigging::rig_meshes(request);
    const rigging::RigReport& report = reports.meshes.at(0);
    if (!report.failure.empty()) throw InputError("", "", report.failure);
    return report.note;
  });
}

std::vector<std::string> template_words() { return rigging::template_words(); }

}  // namespace anigen::engine
