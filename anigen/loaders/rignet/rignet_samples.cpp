#include "anigen/loaders/rignet/rignet_samples.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/skin_transfer.h"
#include "anigen/loaders/anymate/bone_layout.h"
#include "anigen/loaders/rignet/joint_attention.h"
#include "anigen/loaders/rignet/rignet_edges.h"

namespace anigen::loaders {
namespace {

using models::rignet::Task;
using torch::Tensor;

std::vector<int> numbers_of(const Tensor& indices) {
  const Tensor list = indices.to(torch::kInt32).contiguous();
  const auto* first = list.data_ptr<std::int32_t>();
  return std::vector<int>(first, first + list.numel());
}

// True weights of the rig's bones at the graph's vertices, [V, K], taken from the nearest places of the whole mesh.
Tensor bone_weights(const RiggedItem& item, const RignetMesh& mesh, const std::vector<int>& bone_of,
                    std::int64_t bones) {
  Mesh whole;
  whole.vertices = item.vertices;
  whole.faces = item.faces;
  std::vector<Eigen::Vector3f> places;
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    places.emplace_back(mesh.frame.out_of(vertex.cast<double>()).cast<float>());
  }
  const SkinWeights skin = geometry::transfer_attributes(whole, item.skin, places).skin;
  Tensor weights = torch::zeros({static_cast<std::int64_t>(places.size()), bones});
  auto rows = weights.accessor<float, 2>();
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      const int bone = bone_of[at(skin.row(v)[i].joint)];
      if (bone >= 0) rows[static_cast<std::int64_t>(v)][bone] += skin.row(v)[i].weight;
    }
  }
  return weights;
}

// Where points of the whole surface lie on the graph's mesh.
void put_places(const RignetMesh& mesh, const Tensor& points, RignetSample& sample) {
  const auto nearest = geometry::NearestSurface(mesh.vertices, mesh.faces)
                           .query(fields::points_of<double>(in_rignet_frame(points, mesh.frame), "points"));
  const auto count = static_cast<std::int64_t>(nearest.size());
  sample.corners = torch::empty({count, 3}, torch::kInt64);
  sample.shares = torch::empty({count, 3});
  auto* corner = sample.corners.data_ptr<std::int64_t>();
  float* share = sample.shares.data_ptr<float>();
  for (const geometry::NearestPoint& place : nearest) {
    for (std::size_t c = 0; c < 3; ++c) {
      *corner++ = mesh.faces[at(place.at.face)][c];
      *share++ = static_cast<float>(place.at.barycentric[static_cast<Eigen::Index>(c)]);
    }
  }
}

void put_skinning(const RiggedItem& item, const RignetMesh& mesh, const SurfacePaths& paths,
                  const std::vector<int>& bone_of, const RignetConversion& options, RignetSample& sample) {
  const Tensor bones = sample.rig.bones;
  const BoneEnds ends{fields::points_of<double>(in_rignet_frame(bones.narrow(1, 0, 3), mesh.frame), "bones"),
                      fields::points_of<double>(in_rignet_frame(bones.narrow(1, 3, 3), mesh.frame), "bones")};
  sample.slots = bone_slots(volumetric_distances(mesh, paths, ends), ends, options.bones);
  const Tensor weights = bone_weights(item, mesh, bone_of, bones.size(0));
  sample.weights = weights.gather(1, sample.slots.bones.clamp_min(0)).masked_fill(sample.slots.bones < 0, 0.0);
  if (options.held_out) put_places(mesh, sample.rig.points_cloud.narrow(1, 0, 3), sample);
}

RignetSample for_rignet(const RiggedItem& item, const RignetConversion& options) {
  AnymateConversion conversion;
  conversion.points = options.points;
  std::vector<int> bone_of;
  RignetSample sample;
  sample.rig = convert_rig(item, conversion, &bone_of);
  const RignetMesh mesh = rignet_mesh(item.vertices, item.faces, options.mesh.most_vertices);
  const SurfacePaths paths(mesh, options.mesh.geodesic_samples, options.mesh.seed);
  sample.frame = mesh.frame;
  sample.graph = mesh_graph(mesh, paths, options.mesh.seed);
  sample.joints = in_rignet_frame(sample.rig.joints, mesh.frame);
  const auto joints = fields::points_of<double>(sample.joints, "joints");
  switch (options.task) {
    case Task::kJoints:
      sample.attention = joint_attention(mesh, joints, numbers_of(sample.rig.conns));
      if (options.held_out) sample.solid = std::make_shared<const SolidShape>(item.vertices, item.faces);
      break;
    case Task::kConnectivity: {
      const SolidShape::Ways ways = SolidShape(item.vertices, item.faces).ways(joints);
      sample.inside = ways.inside;
      sample.outside = ways.outside;
      break;
    }
    case Task::kSkinning:
      put_skinning(item, mesh, paths, bone_of, options, sample);
      break;
  }
  if (!options.held_out) sample.rig.points_cloud = sample.rig.skins_index = sample.rig.skins_weight = Tensor();
  return sample;
}

}  // namespace

RignetSample convert_for_rignet(const RiggedItem& item, const RignetConversion& options) {
  try {
    return for_rignet(item, options);
  } catch (const InputError& error) {
    if (!error.file().empty()) throw;
    throw InputError(item.id, error.place(), error.problem());
  }
}

Tensor in_rignet_frame(const Tensor& anymate_points, const RignetFrame& frame) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3d& point : fields::points_of<double>(anymate_points, "points")) {
    moved.emplace_back(frame.from_anymate(point).cast<float>());
  }
  return position_rows(moved);
}

std::vector<Eigen::Vector3d> in_anymate_frame(const Tensor& rignet_points, const RignetFrame& frame) {
  std::vector<Eigen::Vector3d> moved = fields::points_of<double>(rignet_points, "points");
  for (Eigen::Vector3d& point : moved) point = frame.to_anymate(point);
  return moved;
}

}  // namespace anigen::loaders
