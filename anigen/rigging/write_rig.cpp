#include "anigen/rigging/write_rig.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/graft.h"
#include "anigen/io/gltf/graft_source.h"
#include "anigen/io/gltf/rig.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"

namespace anigen::rigging {

namespace {

using Points = std::vector<Eigen::Vector3d>;

/// Angle of the upper arms from the horizontal that still is a T-pose.
constexpr double kTPoseDegrees = 20.0;

/// The skeleton as read_gltf() would have it, of one whose shape was read with these axes.
/// @param unrotated its joints have no rotation in the file
Skeleton in_format_axes(Skeleton skeleton, io::Axes axes, bool unrotated) {
  if (axes != io::Axes::kZUp) return skeleton;
  const io::gltf_import::FoldedTransform turn = io::gltf_import::y_up_to_z_up();
  for (Eigen::Matrix4d& bind : skeleton.bind) bind = turn.matrix() * bind;
  skeleton.rest = bind_pose(skeleton);
  return unrotated ? io::unrotated_in_file(skeleton, io::ExportAxes::kGltf) : skeleton;
}

bool is_vrm(const std::filesystem::path& file) { return io::has_extension(file, {".vrm"}); }

/// The members of VRM for an asset and the rig of its engine; nothing for other files.
io::RootExtensions extensions_of(const RigRequest& request, const Asset& asset, const Humanoid& humanoid,
                                 RigReport& report) {
  if (!is_vrm(report.file)) return {};
  const double degrees = degrees_from_t_pose(asset.skeleton, humanoid);
  if (degrees > kTPoseDegrees) {
    log::warn(
        "{}: the upper arms are {:.0f} degrees off the horizontal; VRM expects a T-pose, and motions made for "
        "one will bend the arms by as much",
        report.id, degrees);
  }
  VrmMeta meta = request.vrm;
  if (meta.name.empty()) meta.name = asset.name;
  const std::vector<Spring> springs = find_springs(asset.skeleton, humanoid, asset.mesh, asset.skin);
  const auto bones =
      std::count_if(humanoid.joints.begin(), humanoid.joints.end(), [](int joint) { return joint >= 0; });
  add_note(std::to_string(bones) + " bones, " + std::to_string(springs.size()) + " springs", report);
  return [skeleton = asset.skeleton, humanoid, springs, meta](const std::vector<int>& node_of_joint) {
    return vrm_extensions(skeleton, humanoid, springs, meta, node_of_joint);
  };
}

/// Options of a graft for the rig of an engine, and the skeleton that goes with them.
/// @param asset with that rig @param given the skeleton before it
Skeleton grafted_skeleton(const RigRequest& request, const EngineRig& rig, const Asset& asset, const Skeleton& given,
                          io::GraftOptions& options) {
  if (rig.has_given_joints) {
    // A file's own joints are known by their names.
    options.names = asset.skeleton.names;
    Skeleton skeleton = in_format_axes(asset.skeleton, request.axes, true);
    skeleton.names = names_before(rig, given);
    return skeleton;
  }
  const Eigen::Matrix4d turn = io::gltf_import::y_up_to_z_up().matrix();
  options.placement = rig.placement;
  if (request.axes == io::Axes::kZUp && rig.placement != Eigen::Matrix4d::Identity())
    options.placement = turn * rig.placement * turn.transpose();
  options.replace = true;
  return in_format_axes(asset.skeleton, request.axes, request.engine.axes != BoneAxes::kAlong);
}

/// Takes back that the joints are those of the mesh's file.
void tell_new_joints(RigReport& report) {
  const std::string kept = kKeepsJoints;
  const std::size_t place = report.note.find(kept);
  if (place != std::string::npos) report.note.replace(place, kept.size(), "new joints in the places of its own");
}

/// Says that the clips of the mesh's file, if there are any, are not in the new one.
void tell_left_out(const io::RiggedShape& shape, const std::string& why, RigReport& report) {
  if (shape.clips == nullptr) return;
  const std::size_t clips = shape.clips->animations.size();
  add_note(std::to_string(clips) + (clips == 1 ? " clip" : " clips") + " left out: " + why, report);
}

/// The skeleton of the mesh's file in the shape's frame, with its clips; axes of joints are known where there are some.
Skeleton own_skeleton(const io::RiggedShape& shape, std::vector<Animation>& animations) {
  if (shape.clips == nullptr) {
    io::RiggedShape bare(shape.id, shape.file);
    bare.joints = shape.joints;
    bare.joint_names = shape.joint_names;
    return io::to_asset(bare).skeleton;
  }
  Skeleton own = shape.clips->skeleton;
  animations = shape.clips->animations;
  io::turn_rig(shape.clips_turn, own, animations);
  return own;
}

}  // namespace

void add_note(const std::string& note, RigReport& report) {
  if (!note.empty()) report.note += (report.note.empty() ? "" : ", ") + note;
}

std::vector<std::string> names_before(const EngineRig& rig, const Skeleton& given) {
  if (!rig.has_given_joints) return {};
  std::vector<std::string> names(given.size());
  for (std::size_t j = 0; j < given.size(); ++j) names[at(rig.new_joint[j])] = given.names[j];
  return names;
}

void add_own_clips(const io::RiggedShape& shape, const std::vector<std::string>& names, Asset& asset,
                   RigReport& report) {
  const bool is_told_apart = report.note.find(kKeepsJoints) != std::string::npos;
  if (!shape.has_joints() || (shape.clips == nullptr && !is_told_apart)) return;
  std::vector<Animation> animations;
  const Skeleton own = own_skeleton(shape, animations);
  std::string why_not = "the joints are new";
  std::vector<int> numbers;
  if (!names.empty()) {
    const double near = 1e-4 * bounding_box(asset.mesh.vertices).diagonal();
    numbers = io::gltf_import::own_joints(own, asset.skeleton, names, near, why_not);
  }
  if (numbers.empty()) {
    tell_new_joints(report);
    return tell_left_out(shape, why_not, report);
  }
  if (shape.clips == nullptr) return;
  Skeleton skeleton = io::gltf_import::with_further_joints(own, asset.skeleton, numbers);
  for (std::size_t j = 0; j < numbers.size(); ++j) skeleton.names[at(numbers[j])] = asset.skeleton.names[j];
  for (Influence& influence : asset.skin.influences) influence.joint = numbers[at(influence.joint)];
  asset.skeleton = std::move(skeleton);
  asset.animations = std::move(animations);
}

Skeleton oriented(const EngineRig& rig, const EngineOptions& options) {
  return options.axes == BoneAxes::kAlong ? rig.skeleton : io::unrotated_in_file(rig.skeleton, io::ExportAxes::kGltf);
}

void refuse_unfit_vrm(const RigRequest& request, const io::ShapeSource& source) {
  if (!is_vrm(request.out)) return;
  if (!source.is_single_file())
    throw InputError(request.out.string(), "--output", "a .vrm holds one mesh; several go to a folder, as .glb");
  if (!request.method.binding)
    throw InputError(request.out.string(), "--output",
                     "a .vrm needs a mesh with weights, and the skeleton alone is wanted");
  if (!request.engine.humanoid)
    throw InputError(request.out.string(), "--output", "a .vrm needs the bones of a human (EngineOptions::humanoid)");
}

void write_rig(const RigRequest& request, const io::RiggedShape& shape, Asset& asset, RigReport& report) {
  const std::string& mesh_file = shape.file;
  const std::size_t any = std::max<std::size_t>(1, asset.skin.largest_row());
  const std::size_t influences = request.influences > 0 ? request.influences : any;
  const Skeleton given = asset.skeleton;
  EngineRig rig;
  const bool is_for_engine = request.engine.any() && request.method.binding;
  if (is_for_engine) {
    rig = engine_rig(given, bounding_box(asset.mesh.vertices), weight_of_joints(asset.skin, given.size()),
                     request.engine, mesh_file);
    add_note(rig.note, report);
    apply(rig, asset);
    asset.skeleton = oriented(rig, request.engine);
  }
  const std::vector<std::string> names = is_for_engine ? names_before(rig, given) : given.names;
  const io::RootExtensions extensions = extensions_of(request, asset, rig.humanoid, report);
  const bool into_gltf = io::has_extension(report.file, {".glb", ".gltf", ".vrm"});
  if (!request.graft || !request.method.binding || !into_gltf ||
      !io::has_extension(mesh_file, {".glb", ".gltf", ".vrm"})) {
    io::ExportOptions options;
    options.influences = influences;
    options.extensions = extensions;
    if (is_vrm(report.file)) {
      // The members of VRM know the joints by numbers that clips would change.
      if (names.empty()) tell_new_joints(report);
      tell_left_out(shape, "a .vrm written anew has none", report);
      return io::write_gltf(report.file, asset, options);
    }
    Asset written = asset;
    if (request.method.binding)
      add_own_clips(shape, names, written, report);
    else
      tell_left_out(shape, "only the skeleton is written", report);
    return io::write_rigged(report.file, written, options);
  }
  try {
    io::GraftOptions options;
    options.influences = influences;
    options.extensions = extensions;
    const Skeleton skeleton = is_for_engine ? grafted_skeleton(request, rig, asset, given, options)
                                            : in_format_axes(asset.skeleton, request.axes, true);
    const io::GraftReport grafted = io::graft_rig(mesh_file, skeleton, asset.skin, report.file, options);
    if (grafted.own_joints && !options.names.empty()) log::debug("{}: own joints renamed", report.id);
    if (!grafted.own_joints) tell_new_joints(report);
    for (const io::ImportNote& note : grafted.notes) {
      if (note.code == "idle_animations")
        add_note(note.message, report);
      else
        log::info("{}: {}", report.id, note.message);
    }
  } catch (const NotSupportedError& error) {
    throw InputError(error.file(), error.place(),
                     error.problem() + "; --no-graft writes a new file with base colour alone");
  }
}

}  // namespace anigen::rigging
