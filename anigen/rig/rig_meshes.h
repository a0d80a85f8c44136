#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/io/rigs/axes.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/rig/joint_proposer.h"
#include "anigen/rig/rigging_method.h"

namespace anigen::rig {

/// The mesh with these joints, bound to them; with its materials and pictures, without its own rig.
/// @param joints in the mesh's frame @throws InputError without a surface, and as bind()
Asset bound_asset(const io::RiggedShape& shape, const Skeleton& joints, SkinBinding binding,
                  const BindingOptions& options = {});

/// Callbacks of a learned rigger. An unset one falls back to the request's method.
/// Exceptions count for the mesh they came up with, as failure_of_item() says.
struct LearnedSteps {
  /// @param otherwise whoever else would propose joints, to be asked for the joints that are given
  std::function<ProposedJoints(const io::RiggedShape&, const JointProposer& otherwise)> propose;
  /// Called after it, for the same shape, unless the skeleton alone is wanted. @return one row per vertex
  std::function<SkinWeights(const io::RiggedShape&, const Skeleton&)> bind;
};

/// What to rig and how.
struct RigRequest {
  std::filesystem::path meshes;               ///< a file or a folder of them
  std::vector<std::filesystem::path> splits;  ///< only what these files of ids name; none: all
  io::Axes axes = io::Axes::kFormat;          ///< which way is up in them, when it is not what their format says
  std::filesystem::path out;                  ///< a file for a file, a folder for a folder: <id>.glb each
  RiggingMethod method;                       ///< without a binding each file holds the skeleton alone, as a solid
  JointOptions joints;
  BindingOptions binding;
  LearnedSteps learned;
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
  double joint_seconds = 0.0, binding_seconds = 0.0;  ///< of finding joints, of binding
  double seconds = 0.0;                               ///< of all, with reading and writing
};

struct RigReports {
  std::string skeleton;  ///< whose skeleton was placed by JointSource::kTemplate, else empty
  std::vector<RigReport> meshes;
};

/// Rigs every mesh. One that fails, for whatever reason, is reported and does not stop the others; files are written by
/// rename.
/// @throws InputError when joints cannot be had for any, nothing can be read, or a result would replace an input,
/// before any work; WriteError when the disk refuses; Interrupted after Ctrl-C
RigReports rig_meshes(const RigRequest& request);

Json to_json(const RigReports& reports);
std::string to_text(const RigReports& reports);

}  // namespace anigen::rig
