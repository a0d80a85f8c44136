#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/rig/curve/propose_joints.h"
#include "anigen/rig/embedding/embed_skeleton.h"
#include "anigen/rig/rigging_method.h"
#include "anigen/rig/template_skeleton.h"

namespace anigen::rig {

/// What the sources of joints need to know.
struct JointOptions {
  std::filesystem::path skeleton;             ///< kGiven: the file whose joints to use, in the mesh's frame; empty: the
                                              ///< mesh's own file. kPinocchio: the template; empty: `templates`
  std::vector<std::string> templates;         ///< kPinocchio: of template_words(); the one of least penalty is taken
  std::filesystem::path collection;           ///< kTemplate: whatever io::open_source reads
  std::vector<std::filesystem::path> splits;  ///< of the collection
  CurveSkeletonOptions curve;
  EmbeddingOptions embedding;
};

/// "biped", "quadruped".
std::vector<std::string> template_words();

/// Joints for one mesh.
struct ProposedJoints {
  Skeleton skeleton;  ///< the mesh's frame
  std::string note;   ///< how it came about, for the report; may be empty
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

/// Skeletons of a collection of rigs, each measured by its own mesh. Assets that a data set marks as unusable are left
/// out. @param collection whatever io::open_source reads @param splits files of ids; none: all
/// @throws InputError when nothing is left
std::vector<BoxedSkeleton> skeletons_of(const std::filesystem::path& collection,
                                        const std::vector<std::filesystem::path>& splits);

}  // namespace anigen::rig
