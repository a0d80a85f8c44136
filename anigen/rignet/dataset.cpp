#include "anigen/rignet/dataset.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/data/rigged_item.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/nn/init.h"

namespace anigen::rignet {

namespace {

constexpr double kBallRadius = 0.06;
constexpr std::size_t kMostInBall = 10;

using Neighbours = std::vector<std::vector<std::int64_t>>;

EdgeSet edges_of(const Neighbours& neighbours) {
  std::vector<std::int64_t> counts, sources;
  for (const std::vector<std::int64_t>& list : neighbours) {
    counts.push_back(static_cast<std::int64_t>(list.size()));
    sources.insert(sources.end(), list.begin(), list.end());
  }
  return {starts_of(counts), torch::tensor(sources, torch::kInt64)};
}

// Everyone is its own neighbour, first.
Neighbours themselves(std::size_t vertices) {
  Neighbours neighbours(vertices);
  for (std::size_t v = 0; v < vertices; ++v) neighbours[v].push_back(static_cast<std::int64_t>(v));
  return neighbours;
}

Neighbours one_ring(const RignetMesh& mesh) {
  Neighbours neighbours = themselves(mesh.vertices.size());
  const MeshEdges edges(mesh.faces, mesh.vertices.size());
  for (const MeshEdges::Edge& edge : edges.all()) {
    neighbours[at(edge[0])].push_back(edge[1]);
    neighbours[at(edge[1])].push_back(edge[0]);
  }
  return neighbours;
}

Neighbours geodesic_balls(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed) {
  Neighbours neighbours = themselves(mesh.vertices.size());
  for (std::size_t v = 0; v < neighbours.size(); ++v) {
    std::vector<std::int64_t> members;
    for (const auto& reached : paths.within(static_cast<std::int32_t>(v), kBallRadius))
      members.push_back(reached.vertex);
    Rng rng(seed, "rignet ball", v);
    for (std::size_t i = 0; i < std::min(kMostInBall, members.size()); ++i) {
      std::swap(members[i], members[i + rng.index(members.size() - i)]);
      neighbours[v].push_back(members[i]);
    }
  }
  return neighbours;
}

constexpr int kRays = 14;
constexpr double kHitPercentile = 20.0, kHitFactor = 2.0, kAttentionReach = 0.02;
constexpr std::size_t kLeastAttending = 6;

// Distances to the surface around one end of a bone.
std::vector<Eigen::Vector3d> hits_around(const geometry::RayCaster& caster, const Eigen::Vector3d& end,
                                         const Eigen::Vector3d& along) {
  const Eigen::Vector3d side = along.unitOrthogonal(), up = along.cross(side);
  std::vector<Eigen::Vector3d> ways;
  std::vector<float> distances;
  for (int ray = 0; ray < kRays; ++ray) {
    const double angle = 2.0 * kPi * ray / kRays;
    const Eigen::Vector3d way = std::cos(angle) * side + std::sin(angle) * up;
    if (const std::optional<double> hit = caster.first_hit(end, way)) {
      ways.push_back(way);
      distances.push_back(static_cast<float>(*hit));
    }
  }
  std::vector<Eigen::Vector3d> hits;
  if (distances.empty()) return hits;
  const double most = kHitFactor * percentile(distances, kHitPercentile);
  for (std::size_t i = 0; i < ways.size(); ++i) {
    if (distances[i] < most) hits.emplace_back(end + distances[i] * ways[i]);
  }
  return hits;
}

// The six vertices nearest to a joint.
std::vector<std::size_t> nearest_six(const RignetMesh& mesh, const Eigen::Vector3d& joint) {
  std::vector<std::size_t> order(mesh.vertices.size());
  std::iota(order.begin(), order.end(), 0);
  const std::size_t count = std::min(kLeastAttending, order.size());
  const auto squared = [&](std::size_t v) { return (mesh.vertices[v].cast<double>() - joint).squaredNorm(); };
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [&](std::size_t a, std::size_t b) { return squared(a) < squared(b); });
  order.resize(count);
  return order;
}

constexpr double kSeenWithin = 1e-4, kSeenPercentile = 15.0, kSeenFactor = 1.3, kUnreachable = 8.0;
constexpr double kLeastDistance = 0.01, kSamePlace = 1e-6;

// Distances of one bone along straight lines, and who sees it near enough.
struct Sight {
  std::vector<double> straight;       // [V]
  std::vector<std::int32_t> seen_by;  // vertices, ascending
};

Sight sight_of(const RignetMesh& mesh, const geometry::RayCaster& caster, const Eigen::Vector3d& head,
               const Eigen::Vector3d& tail) {
  Sight sight;
  std::vector<std::int32_t> visible;
  std::vector<float> lengths;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3d vertex = mesh.vertices[v].cast<double>();
    const Eigen::Vector3d from = head + geometry::nearest_on_segment(vertex, head, tail) * (tail - head);
    const double length = (vertex - from).norm();
    sight.straight.push_back(length);
    if (length > kSeenWithin) {
      const std::optional<double> hit = caster.first_hit(from, vertex - from);
      if (hit && *hit < length - kSeenWithin) continue;
    }
    visible.push_back(static_cast<std::int32_t>(v));
    lengths.push_back(static_cast<float>(length));
  }
  if (visible.empty()) return sight;
  const double most = kSeenFactor * percentile(lengths, kSeenPercentile);
  for (const std::int32_t v : visible) {
    if (sight.straight[at(v)] <= most) sight.seen_by.push_back(v);
  }
  return sight;
}

bool is_tip(const BoneEnds& bones, std::size_t bone) {
  for (std::size_t other = 0; other < bones.heads.size(); ++other) {
    if (other != bone && (bones.heads[other] - bones.tails[bone]).norm() <= kSamePlace) return false;
  }
  return true;
}

std::vector<int> numbers_of(const Tensor& indices) {
  const Tensor list = indices.to(torch::kInt32).contiguous();
  const auto* first = list.data_ptr<std::int32_t>();
  return std::vector<int>(first, first + list.numel());
}

// True weights of the rig's bones at the graph's vertices, [V, K], taken from the nearest places of the whole mesh.
Tensor bone_weights(const data::RiggedItem& item, const RignetMesh& mesh, const std::vector<int>& bone_of,
                    std::int64_t bones) {
  Mesh whole;
  whole.vertices = item.vertices;
  whole.faces = item.faces;
  std::vector<Eigen::Vector3f> places;
  for (const Eigen::Vector3f& vertex : mesh.vertices)
    places.emplace_back(mesh.frame.out_of(vertex.cast<double>()).cast<float>());
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

// Positions of points of the whole surface on the graph's mesh.
void put_places(const RignetMesh& mesh, const Tensor& points, RignetSample& sample) {
  const auto nearest = geometry::NearestSurface(mesh.vertices, mesh.faces)
                           .query(nn::points_of<double>(in_rignet_frame(points, mesh.frame), "points"));
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

void put_skinning(const data::RiggedItem& item, const RignetMesh& mesh, const SurfacePaths& paths,
                  const std::vector<int>& bone_of, const RignetConversion& options, RignetSample& sample) {
  const Tensor bones = sample.rig.bones;
  const BoneEnds ends{nn::points_of<double>(in_rignet_frame(bones.narrow(1, 0, 3), mesh.frame), "bones"),
                      nn::points_of<double>(in_rignet_frame(bones.narrow(1, 3, 3), mesh.frame), "bones")};
  sample.slots = bone_slots(volumetric_distances(mesh, paths, ends), ends, options.bones);
  const Tensor weights = bone_weights(item, mesh, bone_of, bones.size(0));
  sample.weights = weights.gather(1, sample.slots.bones.clamp_min(0)).masked_fill(sample.slots.bones < 0, 0.0);
  if (options.held_out) put_places(mesh, sample.rig.points_cloud.narrow(1, 0, 3), sample);
}

RignetSample for_rignet(const data::RiggedItem& item, const RignetConversion& options) {
  anymate::AnymateConversion conversion;
  conversion.points = options.points;
  std::vector<int> bone_of;
  RignetSample sample;
  sample.rig = anymate::convert_rig(item, conversion, &bone_of);
  const RignetMesh mesh = rignet_mesh(item.vertices, item.faces, options.mesh.most_vertices);
  const SurfacePaths paths(mesh, options.mesh.geodesic_samples, options.mesh.seed);
  sample.frame = mesh.frame;
  sample.graph = mesh_graph(mesh, paths, options.mesh.seed);
  sample.joints = in_rignet_frame(sample.rig.joints, mesh.frame);
  const auto joints = nn::points_of<double>(sample.joints, "joints");
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

// @throws InputError naming the asset: as convert_rig and rignet_mesh
RignetSample convert_for_rignet(const data::RiggedItem& item, const RignetConversion& options) {
  return data::naming(item.id, [&] { return for_rignet(item, options); });
}

std::shared_ptr<const RignetDataset> converted_set(const std::vector<data::AssetId>& assets,
                                                   const RignetDatasetOptions& options, bool held_out) {
  RignetConversion conversion = options.conversion;
  conversion.held_out = held_out;
  auto all = data::convert_assets<RignetSample>(
      assets, [&](const data::RiggedItem& item) { return convert_for_rignet(item, conversion); },
      [&](const RignetSample& sample) { return options.problem(sample.rig); });
  all.report(options.skip_broken, held_out ? "hold out" : "train on");
  return std::make_shared<const RignetDataset>(std::move(all.samples), all.repeat);
}

}  // namespace

MeshGraph mesh_graph(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed) {
  return {data::points_tensor(mesh.vertices), edges_of(one_ring(mesh)), edges_of(geodesic_balls(mesh, paths, seed)),
          starts_of({static_cast<std::int64_t>(mesh.vertices.size())})};
}

torch::Tensor joint_attention(const RignetMesh& mesh, const std::vector<Eigen::Vector3d>& joints,
                              const std::vector<int>& parents) {
  const geometry::RayCaster caster(mesh.vertices, mesh.faces);
  std::vector<std::vector<Eigen::Vector3d>> hits(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::size_t parent = at(parents[j]);
    const Eigen::Vector3d bone = joints[j] - joints[parent];
    if (!(bone.norm() > 1e-9)) continue;
    for (const std::size_t end : {j, parent}) {
      const auto found = hits_around(caster, joints[end], bone.normalized());
      hits[end].insert(hits[end].end(), found.begin(), found.end());
    }
  }
  torch::Tensor attention = torch::zeros({static_cast<std::int64_t>(mesh.vertices.size())});
  float* attends = attention.data_ptr<float>();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    std::size_t count = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
      const Eigen::Vector3d vertex = mesh.vertices[v].cast<double>();
      const bool is_near = std::any_of(hits[j].begin(), hits[j].end(), [&](const Eigen::Vector3d& hit) {
        return (hit - vertex).norm() <= kAttentionReach;
      });
      if (!is_near) continue;
      attends[v] = 1.0F;
      ++count;
    }
    if (count >= kLeastAttending) continue;
    for (const std::size_t v : nearest_six(mesh, joints[j])) attends[v] = 1.0F;
  }
  return attention;
}

std::vector<double> volumetric_distances(const RignetMesh& mesh, const SurfacePaths& paths, const BoneEnds& bones) {
  const geometry::RayCaster caster(mesh.vertices, mesh.faces);
  const std::size_t count = bones.heads.size();
  std::vector<double> distances(mesh.vertices.size() * count);
  for (std::size_t k = 0; k < count; ++k) {
    const Sight sight = sight_of(mesh, caster, bones.heads[k], bones.tails[k]);
    const auto nearest = paths.from(sight.seen_by);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
      const std::int32_t by = nearest[v].source;
      distances[v * count + k] =
          by < 0 ? kUnreachable + sight.straight[v] : nearest[v].distance + sight.straight[at(by)];
    }
    for (const std::int32_t v : sight.seen_by) distances[at(v) * count + k] = sight.straight[at(v)];
  }
  return distances;
}

BoneSlots bone_slots(const std::vector<double>& distances, const BoneEnds& bones, std::int64_t slots) {
  const std::size_t count = bones.heads.size();
  const auto vertices = static_cast<std::int64_t>(count == 0 ? 0 : distances.size() / count);
  std::vector<float> tips;
  for (std::size_t k = 0; k < count; ++k) tips.push_back(is_tip(bones, k) ? 1.0F : 0.0F);
  constexpr std::int64_t kNumbers = kBoneNumbers;
  BoneSlots found{torch::full({vertices, slots}, -1, torch::kInt64), torch::zeros({vertices, slots * kNumbers})};
  auto* chosen = found.bones.data_ptr<std::int64_t>();
  float* features = found.features.data_ptr<float>();
  const std::size_t filled = std::min(count, static_cast<std::size_t>(slots));
  std::vector<std::size_t> order(count);
  for (std::int64_t v = 0; v < vertices; ++v, chosen += slots, features += slots * kNumbers) {
    const double* row = distances.data() + static_cast<std::size_t>(v) * count;
    std::iota(order.begin(), order.end(), 0);
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(filled), order.end(),
                      [&](std::size_t a, std::size_t b) { return row[a] != row[b] ? row[a] < row[b] : a < b; });
    float* out = features;
    for (std::size_t s = 0; s < filled; ++s) {
      const std::size_t bone = order[s];
      chosen[s] = static_cast<std::int64_t>(bone);
      for (const Eigen::Vector3d* end : {&bones.heads[bone], &bones.tails[bone]}) {
        for (int axis = 0; axis < 3; ++axis) *out++ = static_cast<float>((*end)[axis]);
      }
      *out++ = static_cast<float>(1.0 / std::max(row[bone], kLeastDistance));
      *out++ = tips[bone];
    }
  }
  return found;
}

Tensor in_rignet_frame(const Tensor& anymate_points, const RignetFrame& frame) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3d& point : nn::points_of<double>(anymate_points, "points"))
    moved.emplace_back(frame.from_anymate(point).cast<float>());
  return data::points_tensor(moved);
}

std::vector<Eigen::Vector3d> in_anymate_frame(const Tensor& rignet_points, const RignetFrame& frame) {
  std::vector<Eigen::Vector3d> moved = nn::points_of<double>(rignet_points, "points");
  for (Eigen::Vector3d& point : moved) point = frame.to_anymate(point);
  return moved;
}

RignetMeshOptions read_rignet_mesh_options(ConfigReader& reader) {
  RignetMeshOptions options;
  options.most_vertices = static_cast<std::size_t>(reader.integer("most_vertices", 2000, 16, 20000));
  options.geodesic_samples = static_cast<std::size_t>(reader.integer("geodesic_samples", 4000, 0, 100000));
  return options;
}

RignetDatasetOptions RignetDatasetOptions::read(ConfigReader& reader) {
  RignetDatasetOptions options;
  options.conversion.mesh = read_rignet_mesh_options(reader);
  options.conversion.points = static_cast<std::size_t>(reader.integer("points", 8192, 1, 1 << 20));
  options.read_sizes(reader);
  options.read_common(reader);
  options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", true);
  return options;
}

RignetDataset::RignetDataset(std::vector<RignetSample> samples, const std::vector<std::size_t>& repeat)
    : samples_(std::move(samples)) {
  for (std::size_t i = 0; i < samples_.size(); ++i) visits_.insert(visits_.end(), repeat[i], i);
}

std::unique_ptr<data::Batch> RignetDataset::load(const std::vector<data::Draw>& draws) const {
  auto batch = std::make_unique<RignetDraws>();
  for (const data::Draw& draw : draws) {
    batch->samples.push_back(samples_[visits_[draw.item]]);
    batch->ids.push_back(batch->samples.back().rig.name);
  }
  return batch;
}

RignetDatasets open_rignet(const RignetDatasetOptions& options) {
  const data::TrainAndEval assets = data::select(options);
  data::refuse_test_creatures(assets, options);
  RignetDatasets sets;
  sets.train = converted_set(assets.train, options, /*held_out=*/false);
  if (!assets.eval.empty()) sets.held_out = converted_set(assets.eval, options, /*held_out=*/true);
  return sets;
}

}  // namespace anigen::rignet
