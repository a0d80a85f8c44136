#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/anymate/model.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/config.h"
#include "anigen/data/batches.h"
#include "anigen/data/metadata.h"
#include "anigen/data/rigged_item.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

/// A skeleton as Anymate's data describe one: bones with two ends, and the joints that these ends are
/// (docs/reference/anymate.md, 1.2 and 1.5). Links from the end of a bone with several children to these are no bones.
struct BoneLayout {
  std::vector<Eigen::Vector3f> joints;        ///< [J] ends of bones, each position once, heads first
  std::vector<int> conns;                     ///< [J] parent of each joint; a root's own index
  std::vector<Eigen::Vector3f> heads, tails;  ///< [K]
  std::vector<int> bone_of;                   ///< [joints of the rig] the bone that carries its weights, -1: none
};

/// Joints that nothing hangs on go first, their children to their parents (reference, 1.3, item 4). Then every joint is
/// the head of a bone. Its tail is its child where it has one child; with none or several it points where its weights
/// are, seen from its head, a quarter farther than their mean.
/// @param joints [Jr] the rig's @param parents [Jr], -1 for a root @param used [Jr] whether the mesh hangs on it
/// @param points [P] on the surface @param skin [P] rows over the rig's joints
/// @throws InputError when no joint is used, when two bones end at one point, or when an end of a bone would have
///   two parents: such rigs are rejected, as published
BoneLayout lay_out_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                         const std::vector<bool>& used, const std::vector<Eigen::Vector3f>& points,
                         const SkinWeights& skin);

/// Frame that Anymate's models expect: Y up, the middle of its box at the origin, its longest side from -1 to 1
/// (docs/reference/anymate.md, 1.3). The released data put the middle of the *sampled points* there instead, which is
/// the same but for chance.
class AnymateFrame {
 public:
  /// @param vertices Z up @throws InputError when they are not finite or have no extent
  static AnymateFrame of(const std::vector<Eigen::Vector3f>& vertices);

  Eigen::Vector3d into(const Eigen::Vector3d& point) const;    ///< from the Z-up frame
  Eigen::Vector3d out_of(const Eigen::Vector3d& point) const;  ///< back

 private:
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();
  double scale_ = 1.0;
};

/// A surface in that frame.
struct AnymateMesh {
  AnymateFrame frame;
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;            ///< [F], F > 0
};

/// @param vertices [V] Z up @throws InputError as AnymateFrame::of, without faces, or for a face without its vertices
AnymateMesh anymate_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

/// Positions and normals of the faces, [N, 6] fp32: what encoders look at. A face without area has normal (0, 1, 0).
torch::Tensor surface_features(const AnymateMesh& mesh, const std::vector<geometry::SurfacePoint>& points);

/// Positions and area-weighted normals of all vertices, [V, 6] fp32: where skin weights are wanted.
torch::Tensor vertex_features(const AnymateMesh& mesh);

/// The cells of the 64³ grid over [-1, 1]³ whose middle is inside the mesh or on its wall, [Nv, 3] int8
/// (docs/reference/anymate.md, 1.4): the grid that fields of joints are asked about. Open meshes will do.
torch::Tensor solid_cells(const AnymateMesh& mesh);

struct AnymateConversion {
  std::size_t points = 8192;  ///< of the surface
  bool cells = false;         ///< also the cells inside, which fields of joints need
  std::uint64_t seed = 0;     ///< of the points
};

/// A rigged mesh as a sample of Anymate's data (docs/reference/anymate.md, 1.7): points with face normals, uniform over
/// the surface; bones and joints of lay_out_bones(); weights of the bones, interpolated within faces.
/// @param bone_of filled, where wanted, with the bone of each of the rig's joints, -1 for none
/// @throws InputError naming the asset: as anymate_mesh and lay_out_bones
AnymateSample convert_rig(const data::RiggedItem& item, const AnymateConversion& options = {},
                          std::vector<int>* bone_of = nullptr);

/// Samples of Anymate, to be collated by whoever trains on them.
struct AnymateDraws : data::Batch {
  std::vector<AnymateSample> samples;
};

/// Sizes of rigs outside of which samples are left out (released: 9 to 63 bones).
struct RigSizes {
  std::size_t min_bones = 1, max_bones = 64, max_joints = 96;

  void read_sizes(ConfigReader& reader);
  /// Why a sample is left out; empty: it is not.
  std::string problem(const AnymateSample& sample) const;
};

/// `dataset.args` of the class "Anymate" (ours: the released code reads its files by fixed names). Assets come from
/// prepared data sets (data_dir and what goes with it, source_options.h), or from released files.
struct AnymateDatasetOptions : data::SourceOptions, RigSizes {
  std::vector<std::string> shards, eval_shards;  ///< `.pt` files; given, data_dir is not read
  std::size_t points = 8192;                     ///< of a sample, drawn anew from those of a file that has more
  bool cells = false;                            ///< sets by the trainer: fields of joints need them

  static AnymateDatasetOptions read(ConfigReader& reader);
};

/// Samples in memory: half a megabyte each with 8,192 points.
class AnymateDataset : public data::BatchSource {
 public:
  /// @param repeat how often an epoch visits each sample @param points rows of a draw @param seed of their choice
  AnymateDataset(std::vector<AnymateSample> samples, std::vector<std::size_t> repeat, std::size_t points,
                 std::uint64_t seed);

  std::size_t size() const override { return visits_.size(); }
  std::size_t samples() const { return samples_.size(); }
  std::unique_ptr<data::Batch> load(const std::vector<data::Draw>& draws) const override;
  /// A sample with its first points.
  AnymateSample sample(std::size_t index) const;

 private:
  std::vector<AnymateSample> samples_;
  std::vector<std::size_t> visits_;
  std::size_t points_;
  std::uint64_t seed_;
};

struct AnymateDatasets {
  std::shared_ptr<const AnymateDataset> train, held_out;  ///< the latter null when nothing is held out
};

/// Reads and converts everything. What has too many or too few joints or bones, or a skeleton that the conversion
/// rejects, is left out, counted and, with debug messages, named.
/// @throws InputError when nothing is left, and for files that cannot be read unless skip_broken
AnymateDatasets open_anymate(const AnymateDatasetOptions& options, std::uint64_t seed);

}  // namespace anigen::anymate
