#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigid_parts.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/config.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/rigging/binding.h"
#include "anigen/rigging/curve.h"
#include "anigen/rigging/engine_rig.h"
#include "anigen/rigging/pinocchio.h"
#include "anigen/rigging/skeleton_edits.h"
#include "anigen/rigging/species_templates.h"
#include "anigen/rigging/vrm.h"

namespace anigen::rigging {

/// A skeleton whose joints are measured by the bounding box of its mesh: 0 at the lower, 1 at the upper side of each
/// axis. Joints may lie outside.
struct BoxedSkeleton {
  std::string id;
  std::vector<Eigen::Vector3d> joints;  ///< [J]
  std::vector<int> parents;             ///< [J], -1 for the root
};

/// @throws InputError naming `id` when there is no joint, a number is not finite, or the box is empty. Along an axis
/// without extent every joint is at 0.5.
BoxedSkeleton boxed_skeleton(const std::string& id, const std::vector<Eigen::Vector3d>& joints,
                             const std::vector<int>& parents, const Box& box);

/// Joints of a boxed skeleton in another box.
std::vector<Eigen::Vector3d> placed_joints(const BoxedSkeleton& skeleton, const Box& box);

/// The index of the skeleton with the least sum of distances to all others, the first of equals. Skeletons of different
/// trees have no mean that is one; the medoid is the mean's nearest relative that is always a skeleton. Distance is
/// the symmetric mean of nearest-joint distances (J2J) in box coordinates. O(N² J²), on all threads.
/// @throws InputError without skeletons
std::size_t medoid(const std::vector<BoxedSkeleton>& skeletons);

/// Source of the joints of a mesh.
enum class JointSource {
  kGiven,      ///< the mesh's own file, or another one
  kTemplate,   ///< the middle skeleton of a collection, by bounding box (medoid())
  kCurve,      ///< the curve that the mesh contracts to (propose_curve_skeleton())
  kPinocchio,  ///< a template embedded in the mesh (choose_template())
  kAuto  ///< the mesh's own skeleton where it has one or one is given, else a template that fits, else learned joints
         ///< where there are some (JointOptions::learned), else its curve
};

/// Penalty of an embedded template up to which JointSource::kAuto prefers it to the mesh's curve: least J2J over 54
/// skeletons of public rigs, on a wide minimum (docs/results.md).
inline constexpr double kTrustedPenalty = 0.2;

/// Classical rigger of a mesh.
struct RiggingMethod {
  JointSource joints = JointSource::kGiven;
  std::optional<SkinBinding> binding = SkinBinding::kGeodesicVoxels;  ///< nothing: joints only
};

/// "auto": joints by JointSource::kAuto, with fitted_heat(); "nearest", "geovoxel", "heat": that binding to given
/// joints; "template": with the nearest bone, as a baseline that looks at nothing; "curve": with geodesic voxels;
/// "pinocchio": with heat, as published.
/// @param skin "": as above; "none": joints only; or the word of a binding
/// @throws InputError for another word, naming all of them
RiggingMethod parse_rigging_method(const std::string& method, const std::string& skin = "");
std::vector<std::string> rigging_method_words();

/// Joints for one mesh.
struct ProposedJoints {
  Skeleton skeleton;  ///< the mesh's frame
  std::string note;   ///< how it came about, for the report; may be empty
};

/// Joints of a mesh by whoever has learned to find them; nothing where it is not sure of them, and `why_not` says why.
using SureJoints = std::function<std::optional<ProposedJoints>(const io::RiggedShape&, std::string& why_not)>;

/// Options of the sources of joints.
struct JointOptions {
  std::filesystem::path skeleton;      ///< kGiven, kAuto: the file whose joints to use, in the mesh's frame;
                                       ///< empty: the mesh's own file. kPinocchio: the template; empty: `templates`
  std::vector<std::string> templates;  ///< kPinocchio, kAuto: of template_words(); that of least penalty is taken,
                                       ///< however large that is; empty: usual_template_words()
  bool keep_skeleton = true;           ///< kAuto: the mesh's own joints stay, where it has any
  std::filesystem::path collection;    ///< kTemplate: whatever io::open_source reads
  std::vector<std::filesystem::path> splits;  ///< of the collection
  CurveSkeletonOptions curve;
  EmbeddingOptions embedding;
  SureJoints learned;            ///< kAuto: go before a template that fits; may be unset
  bool templates_first = false;  ///< kAuto: a template that fits goes before learned joints
};

/// Finds joints for one mesh after another; what they share is read once. Const: several threads may ask at once.
class JointProposer {
 public:
  /// @throws InputError for a file that holds no skeleton, an unknown template, or a collection without skeletons
  JointProposer(JointSource source, JointOptions options);

  /// Reads the mesh only; a rig in its file counts for JointSource::kGiven alone.
  /// @throws InputError when there are no joints to be had
  ProposedJoints propose(const io::RiggedShape& shape) const;

  /// The id of the skeleton that JointSource::kTemplate places, else empty.
  const std::string& template_id() const { return boxed_.id; }

 private:
  JointSource source_;
  JointOptions options_;
  BoxedSkeleton boxed_;                      // kTemplate
  Skeleton given_;                           // kGiven, of another file
  std::vector<TemplateSkeleton> templates_;  // kPinocchio
};

/// Callbacks of a learned rigger. An unset one falls back to the request's method.
/// Exceptions count for the mesh they came up with, as failure_of_item() says.
struct LearnedSteps {
  /// @param otherwise whoever else would propose joints, to be asked for the joints that are given
  std::function<ProposedJoints(const io::RiggedShape&, const JointProposer& otherwise)> propose;
  SureJoints sure;  ///< for JointOptions::learned; rig_meshes() itself does not call it
  /// Called after it, for the same shape, unless the skeleton alone is wanted. @return one row per vertex
  std::function<SkinWeights(const io::RiggedShape&, const Skeleton&)> bind;
};

/// Meshes to rig, and the method.
struct RigRequest {
  std::filesystem::path meshes;               ///< a file or a folder of them
  std::vector<std::filesystem::path> splits;  ///< only what these files of ids name; none: all
  io::Axes axes = io::Axes::kFormat;          ///< which way is up in them, when it is not what their format says
  std::filesystem::path out;   ///< a file for a file, in the format of its extension, which may also be .vrm (1.0) for
                               ///< humanoids, with `engine.humanoid`; a folder for a folder
  std::string format = "glb";  ///< of io::rigged_format_words(): of the files in a folder, <id>.<format> each
  RiggingMethod method;        ///< without a binding each file holds the skeleton alone, as a solid
  JointOptions joints;
  SkeletonEdits edits;          ///< of whatever joints there are; of several bodies each by itself
  bool separate_bodies = true;  ///< kAuto: bodies that stand apart get joints and weights one by one, below one root
  BindingOptions binding;       ///< of its heat, JointSource::kAuto takes the number of influences alone
  EngineOptions engine;
  VrmMeta vrm;  ///< of a .vrm; its name is the id
  LearnedSteps learned;
  std::optional<double> rigid_share;  ///< shells with such a share of one joint follow it alone (rigid_parts()); unset:
                                      ///< weights stay as they are bound
  std::size_t influences = 4;         ///< joints per vertex in the written files; 0: as many as the weights name
  bool graft = true;  ///< .glb and .gltf to .glb and .gltf: the rig goes into a copy of the file (io::graft_rig); else
                      ///< into a new file with base colour alone
  /// Called for each asset after its file is written, with that file's place.
  std::function<void(const Asset&, const std::filesystem::path&)> also;
  std::string also_writes;                       ///< ending of the file that `also` writes beside it, such as ".png"
  std::vector<std::filesystem::path> also_read;  ///< further inputs, such as files of models: nothing may replace them
};

struct RigReport {
  std::string id;
  std::filesystem::path file;
  std::string failure;  ///< empty: there is a file
  std::string note;     ///< of the joints, such as which template was taken
  std::size_t joints = 0, vertices = 0;
  Json rigid_parts;                                   ///< RigidSkin::to_json(), where it was asked for
  double joint_seconds = 0.0, binding_seconds = 0.0;  ///< of finding joints, of binding
  double seconds = 0.0;                               ///< of all, with reading and writing
};

struct RigReports {
  std::string skeleton;  ///< whose skeleton was placed by JointSource::kTemplate, else empty
  std::vector<RigReport> meshes;
};

/// Rigs one shape: its joints, then its weights unless the method has no binding; the asset is then the skeleton as a
/// solid. Joints and clips of the shape's own file are those of add_own_clips() (write_rig.h) only once that is called.
/// @param report gets note, times and rigid_parts @throws InputError when joints or weights cannot be had; Interrupted
Asset rig_shape(const io::RiggedShape& shape, const JointProposer& proposer, const RigRequest& request,
                RigReport& report);

/// Rigs every mesh. One that fails, for whatever reason, is reported and does not stop the others; files are written by
/// rename.
/// @throws InputError when joints cannot be had for any, nothing can be read, or a result would replace an input,
/// before any work; WriteError when the disk refuses; Interrupted after Ctrl-C
RigReports rig_meshes(const RigRequest& request);

Json to_json(const RigReports& reports);
std::string to_text(const RigReports& reports);

}  // namespace anigen::rigging
