#include "anigen/rigging/skin_features.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bones.h"
#include "anigen/rigging/binding.h"
#include "anigen/rigging/surface.h"

namespace anigen::rigging {

namespace {

constexpr double kLengthFloor = 1e-3;   // added to lengths inside logarithms, in mesh sizes
constexpr double kShareFloor = 1e-3;    // added to shares inside logarithms
constexpr double kMiddleFloor = 0.02;   // added to lengths about the middle of a shell inside logarithms, in mesh sizes
constexpr double kInverseFloor = 0.01;  // added to distances of which the inverse counts, in mesh sizes
constexpr double kFarthestGap = 10.0;   // between joints, in mesh sizes
constexpr double kSameLength = 1e-5;    // lengths that differ by less, in mesh sizes, are equally near

/// Neighbours of places along edges: those of place p from offsets[p] to offsets[p + 1] of the second list.
std::pair<std::vector<std::size_t>, std::vector<std::int32_t>> place_edges(const WeldedSurface& surface) {
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  pairs.reserve(6 * surface.faces.size());
  for (const Triangle& face : surface.faces) {
    for (std::size_t k = 0; k < 3; ++k) {
      pairs.emplace_back(face[k], face[(k + 1) % 3]);
      pairs.emplace_back(face[(k + 1) % 3], face[k]);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  std::vector<std::size_t> offsets(surface.places.size() + 1, 0);
  std::vector<std::int32_t> ends;
  for (const auto& [from, to] : pairs) {
    ++offsets[at(from) + 1];
    ends.push_back(to);
  }
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  return {std::move(offsets), std::move(ends)};
}

/// A third of the faces around each place.
std::vector<double> place_areas(const WeldedSurface& surface) {
  std::vector<double> areas(surface.places.size(), 0.0);
  for (const Triangle& face : surface.faces) {
    const Eigen::Vector3d& a = surface.places[at(face[0])];
    const double twice = (surface.places[at(face[1])] - a).cross(surface.places[at(face[2])] - a).norm();
    for (const std::int32_t corner : face) areas[at(corner)] += twice / 6.0;
  }
  return areas;
}

/// Twice the root of the mean squared distance of the surface from its middle: unlike a box, the same in every frame.
double surface_size(const WeldedSurface& surface, const std::vector<double>& areas) {
  double total = 0.0, square = 0.0;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (std::size_t p = 0; p < areas.size(); ++p) {
    total += areas[p];
    middle += areas[p] * surface.places[p];
  }
  if (!(total > 0.0)) return 1.0;
  middle /= total;
  for (std::size_t p = 0; p < areas.size(); ++p) square += areas[p] * (surface.places[p] - middle).squaredNorm();
  const double size = 2.0 * std::sqrt(square / total);
  return size > 0.0 ? size : 1.0;
}

/// Rows of places out of rows of vertices.
SkinWeights rows_of_places(const SkinWeights& of_vertices, const std::vector<std::int32_t>& vertex_of_place) {
  SkinWeights rows;
  for (const std::int32_t vertex : vertex_of_place) rows.append_copy(of_vertices, at(vertex));
  return rows;
}

double weight_of(const SkinWeights& skin, std::size_t row, std::int32_t joint) {
  const Influence* first = skin.row(row);
  for (std::size_t i = 0; i < skin.row_size(row); ++i) {
    if (first[i].joint == joint) return static_cast<double>(first[i].weight);
  }
  return 0.0;
}

double median_rigidity(const SkinWeights& skin) {
  std::vector<float> largest;
  for (std::size_t row = 0; row < skin.rows(); ++row) {
    if (skin.row_size(row) > 0) largest.push_back(skin.row(row)->weight);
  }
  return largest.empty() ? 1.0 : percentile(std::move(largest), 50.0);
}

float share_log(double share) { return static_cast<float>(std::log(share + kShareFloor)); }

float classical_log(double weight) { return static_cast<float>(std::log(weight + kClassicalFloor)); }

/// The point of a joint's bones that is nearest to a place.
struct NearestBone {
  double distance = std::numeric_limits<double>::infinity();
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double along = 0.0, length = 0.0;
};

NearestBone nearest_bone(const MovingBones& joint, const Eigen::Vector3d& place) {
  NearestBone nearest;
  for (const BoneLine& line : joint.lines) {
    const Eigen::Vector3d way = line.end - line.start;
    const Eigen::Vector3d point = line.start + geometry::nearest_on_segment(place, line.start, line.end) * way;
    const double distance = (point - place).norm();
    if (!(distance < nearest.distance)) continue;
    const double length = way.norm();
    nearest = {distance, point, length > 0.0 ? (place - line.start).dot(way) / (length * length) : 0.0, length};
  }
  return nearest;
}

/// Joints on the way between two along the skeleton, the second one counted.
int tree_hops(const std::vector<int>& parents, const std::vector<int>& depths, std::int32_t a, std::int32_t b) {
  int hops = 0;
  for (; a != b; ++hops) {
    std::int32_t& deeper = depths[at(a)] >= depths[at(b)] ? a : b;
    deeper = parents[at(deeper)];
    if (deeper < 0) return hops;  // of another tree
  }
  return hops;
}

}  // namespace

/// Faces that hang together.
struct SkinShell {
  double area = 0.0, radius = 0.0;  // radius as kShellRadius
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
};

/// Area of each shell and of the surface that prefers each joint.
class JointShares {
 public:
  JointShares() = default;
  JointShares(std::size_t shells, std::size_t joints)
      : joints_(joints), of_shell_(shells * joints, 0.0), of_surface_(joints, 0.0) {}

  void add(std::size_t shell, std::size_t joint, double area) {
    of_shell_[shell * joints_ + joint] += area;
    of_surface_[joint] += area;
  }
  void add(std::size_t shell, const SkinWeights& rows, std::size_t row, double area) {
    for (std::size_t i = 0; i < rows.row_size(row); ++i)
      add(shell, at(rows.row(row)[i].joint), area * static_cast<double>(rows.row(row)[i].weight));
  }
  double of_shell(std::size_t shell, std::size_t joint) const { return of_shell_[shell * joints_ + joint]; }
  double of_surface(std::size_t joint) const { return of_surface_[joint]; }

 private:
  std::size_t joints_ = 0;
  std::vector<double> of_shell_, of_surface_;  // [shells, J], [J]
};

struct SkinFeatures::State {
  std::size_t candidates = 0;
  WeldedSurface surface;
  SurfaceParts shells;
  std::vector<std::size_t> edge_offsets;  // [P + 1]
  std::vector<std::int32_t> edge_ends;
  std::vector<Eigen::Vector3d> normals;  // [P]
  std::vector<MovingBones> bones;        // [J]
  std::vector<int> parents, depths, children;
  int deepest = 1;
  double size = 1.0, total_area = 0.0;
  std::vector<double> areas;     // [P]
  SkinWeights heat, geodesic;    // rows of places, heaviest influence first
  std::vector<SkinShell> shell;  // [shells]
  std::vector<float> reach;      // [shells, J], as kShellReach
  JointShares heat_shares, geodesic_shares, nearest_shares, inverse_shares;
  std::vector<double> joint_gap, below;  // [J]
  std::array<float, kSkinAssetFeatures> asset{};

  std::size_t joints() const { return bones.size(); }
  void bind(const Mesh& mesh, const Skeleton& skeleton, int resolution);
  void measure_tree(const std::vector<int>& parents_of);
  void measure_joints();
  void measure_shells();
  void measure_nearness();
  void summarize();
  Eigen::Vector3d position_of(std::int32_t joint) const { return bones[at(joint)].lines.front().start; }
  std::vector<std::int32_t> candidates_of(std::size_t place, const std::vector<double>& distances) const;
  void write(std::size_t place, std::int32_t* joints_out, float* features) const;
};

void SkinFeatures::State::bind(const Mesh& mesh, const Skeleton& skeleton, int resolution) {
  std::vector<std::int32_t> vertex_of_place(surface.places.size(), 0);
  for (std::size_t v = surface.of_vertex.size(); v-- > 0;)
    vertex_of_place[at(surface.of_vertex[v])] = static_cast<std::int32_t>(v);
  BoneHeatOptions of_heat;
  of_heat.most_influences = candidates;
  heat = rows_of_places(bind_by_heat(mesh, skeleton, of_heat), vertex_of_place);
  GeodesicVoxelOptions of_voxels;
  of_voxels.most_influences = candidates;
  of_voxels.resolution = resolution;
  geodesic = rows_of_places(bind_by_geodesic_voxels(mesh, skeleton, of_voxels), vertex_of_place);
}

void SkinFeatures::State::measure_tree(const std::vector<int>& parents_of) {
  parents = parents_of;
  depths.assign(parents.size(), 0);
  children.assign(parents.size(), 0);
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] < 0) continue;
    depths[j] = depths[at(parents[j])] + 1;
    ++children[at(parents[j])];
    deepest = std::max(deepest, depths[j]);
  }
}

// Takes the square of the number of joints: some thousands at most where a mesh can be bound at all.
void SkinFeatures::State::measure_joints() {
  joint_gap.assign(joints(), kFarthestGap);
  below.assign(joints(), 1.0);
  parallel_for(joints(), [&](std::size_t j) {
    const Eigen::Vector3d own = position_of(static_cast<std::int32_t>(j));
    for (std::size_t other = 0; other < joints(); ++other) {
      if (other == j) continue;
      joint_gap[j] = std::min(joint_gap[j], (position_of(static_cast<std::int32_t>(other)) - own).norm() / size);
    }
  });
  for (std::size_t j = joints(); j-- > 0;) {
    if (parents[j] >= 0) below[at(parents[j])] += below[j];
  }
}

void SkinFeatures::State::measure_shells() {
  constexpr double kLeastArea = 1e-12;  // of a place, so that shells of degenerate faces have a middle, too
  shell.resize(shells.size());
  for (std::size_t p = 0; p < areas.size(); ++p) {
    SkinShell& own = shell[at(shells.of_place[p])];
    own.area += areas[p] + kLeastArea;
    own.middle += (areas[p] + kLeastArea) * surface.places[p];
  }
  for (SkinShell& own : shell) own.middle /= own.area;
  for (std::size_t p = 0; p < areas.size(); ++p) {
    SkinShell& own = shell[at(shells.of_place[p])];
    own.radius += (areas[p] + kLeastArea) * (surface.places[p] - own.middle).squaredNorm();
  }
  for (SkinShell& own : shell) {
    own.radius = std::sqrt(own.radius / own.area) / size;
    total_area += own.area;
  }
  heat_shares = JointShares(shells.size(), joints());
  geodesic_shares = heat_shares;
  for (std::size_t p = 0; p < areas.size(); ++p) {
    const std::size_t own = at(shells.of_place[p]);
    heat_shares.add(own, heat, p, areas[p]);
    geodesic_shares.add(own, geodesic, p, areas[p]);
  }
  measure_nearness();
}

// Each pair of a place and a joint is measured twice, so that no memory goes with the number of pairs.
void SkinFeatures::State::measure_nearness() {
  const std::size_t count = shells.size(), all = joints(), places = surface.places.size();
  const auto inverse = [](double distance) {
    const double square = (distance + kInverseFloor) * (distance + kInverseFloor);
    return 1.0 / (square * square);
  };
  std::vector<double> least(places, std::numeric_limits<double>::infinity()), sums(places, 0.0);
  std::vector<double> equals(places, 0.0);  // joints that are nearest: bones share ends
  parallel_for(places, [&](std::size_t p) {
    std::vector<double> distances(all);
    for (std::size_t j = 0; j < all; ++j) {
      distances[j] = distance_to(bones[j], surface.places[p]) / size;
      sums[p] += inverse(distances[j]);
      least[p] = std::min(least[p], distances[j]);
    }
    for (const double distance : distances) equals[p] += distance < least[p] + kSameLength ? 1.0 : 0.0;
  });
  reach.assign(count * all, 0.0F);
  nearest_shares = JointShares(count, all);
  inverse_shares = nearest_shares;
  parallel_for(all, [&](std::size_t j) {
    std::vector<double> distances(count, std::numeric_limits<double>::infinity());
    for (std::size_t p = 0; p < places; ++p) {
      const std::size_t own = at(shells.of_place[p]);
      const double distance = distance_to(bones[j], surface.places[p]) / size;
      distances[own] = std::min(distances[own], distance);
      inverse_shares.add(own, j, areas[p] * inverse(distance) / sums[p]);
      if (distance < least[p] + kSameLength) nearest_shares.add(own, j, areas[p] / equals[p]);
    }
    const double closest = *std::min_element(distances.begin(), distances.end());
    for (std::size_t s = 0; s < count; ++s)
      reach[s * all + j] = static_cast<float>(std::log((distances[s] + kLengthFloor) / (closest + kLengthFloor)));
  });
}

void SkinFeatures::State::summarize() {
  double largest = 0.0;
  for (const SkinShell& own : shell) largest = std::max(largest, own.area / total_area);
  const auto quarter_log = [](std::size_t n) { return static_cast<float>(0.25 * std::log(static_cast<double>(n))); };
  asset[kJointCount] = quarter_log(joints());
  asset[kShellCount] = quarter_log(std::max<std::size_t>(1, shells.size()));
  asset[kHeatRigidity] = static_cast<float>(median_rigidity(heat));
  asset[kGeodesicRigidity] = static_cast<float>(median_rigidity(geodesic));
  asset[kLargestShellShare] = static_cast<float>(largest);
}

std::vector<std::int32_t> SkinFeatures::State::candidates_of(std::size_t place,
                                                             const std::vector<double>& distances) const {
  const std::size_t wanted = std::min(candidates, joints());
  std::vector<std::int32_t> by_distance(joints());
  std::iota(by_distance.begin(), by_distance.end(), 0);
  std::partial_sort(by_distance.begin(), by_distance.begin() + static_cast<std::ptrdiff_t>(wanted), by_distance.end(),
                    [&](std::int32_t a, std::int32_t b) {
                      return distances[at(a)] != distances[at(b)] ? distances[at(a)] < distances[at(b)] : a < b;
                    });
  std::vector<std::int32_t> chosen;
  const auto choose = [&](std::int32_t joint) {
    if (chosen.size() < wanted && std::find(chosen.begin(), chosen.end(), joint) == chosen.end())
      chosen.push_back(joint);
  };
  for (std::size_t rank = 0; chosen.size() < wanted; ++rank) {
    if (rank < heat.row_size(place)) choose(heat.row(place)[rank].joint);
    if (rank < geodesic.row_size(place)) choose(geodesic.row(place)[rank].joint);
    choose(by_distance[rank]);
  }
  return chosen;
}

void SkinFeatures::State::write(std::size_t place, std::int32_t* joints_out, float* features) const {
  const Eigen::Vector3d& position = surface.places[place];
  std::vector<double> distances;
  distances.reserve(joints());
  for (const MovingBones& joint : bones) distances.push_back(distance_to(joint, position));
  const std::vector<std::int32_t> chosen = candidates_of(place, distances);
  double least = std::numeric_limits<double>::infinity();
  std::vector<double> own_heat, own_geodesic;
  std::size_t best = 0;
  for (std::size_t c = 0; c < chosen.size(); ++c) {
    least = std::min(least, distances[at(chosen[c])] / size);
    own_heat.push_back(weight_of(heat, place, chosen[c]));
    own_geodesic.push_back(weight_of(geodesic, place, chosen[c]));
    const double sum = own_heat[c] + own_geodesic[c], of_best = own_heat[best] + own_geodesic[best];
    if (sum > of_best || (sum == of_best && chosen[c] < chosen[best])) best = c;
  }
  const std::size_t part = at(shells.of_place[place]);
  const SkinShell& own_shell = shell[part];
  const std::size_t first = edge_offsets[place], last = edge_offsets[place + 1];
  for (std::size_t c = 0; c < candidates; ++c, features += kSkinPairFeatures) {
    joints_out[c] = -1;
    std::fill_n(features, static_cast<std::size_t>(kSkinPairFeatures), 0.0F);
    if (c >= chosen.size()) {
      for (const SkinPairFeature log : {kHeatLog, kGeodesicLog, kHeatAround, kGeodesicAround})
        features[log] = classical_log(0.0);
      continue;
    }
    const std::int32_t joint = joints_out[c] = chosen[c];
    const std::size_t j = at(joint);
    const NearestBone bone = nearest_bone(bones[j], position);
    double heat_around = 0.0, geodesic_around = 0.0;
    for (std::size_t e = first; e < last; ++e) {
      heat_around += weight_of(heat, at(edge_ends[e]), joint);
      geodesic_around += weight_of(geodesic, at(edge_ends[e]), joint);
    }
    const auto around = static_cast<double>(last - first);
    const double distance = bone.distance / size;
    const auto nearer = std::count_if(chosen.begin(), chosen.end(), [&](std::int32_t other) {
      return distances[at(other)] / size < distance - kSameLength;
    });
    const Eigen::Vector3d way = bone.point - position;
    const double facing = bone.distance > 0.0 ? normals[place].dot(way) / bone.distance : 0.0;
    features[kHeatLog] = classical_log(own_heat[c]);
    features[kGeodesicLog] = classical_log(own_geodesic[c]);
    features[kHeatAround] = classical_log(around > 0.0 ? heat_around / around : own_heat[c]);
    features[kGeodesicAround] = classical_log(around > 0.0 ? geodesic_around / around : own_geodesic[c]);
    features[kBoneDistance] = static_cast<float>(distance);
    features[kDistanceRank] = static_cast<float>(static_cast<double>(nearer) / static_cast<double>(chosen.size()));
    features[kDistanceRatio] = static_cast<float>(std::log((distance + kLengthFloor) / (least + kLengthFloor)));
    features[kAlongBone] = static_cast<float>(std::clamp(bone.along, -2.0, 3.0));
    features[kBoneLength] = static_cast<float>(bone.length / size);
    features[kFacing] = static_cast<float>(facing);
    const double of_joint = heat_shares.of_surface(j);
    features[kShellHeatShare] = of_joint > 0.0 ? static_cast<float>(heat_shares.of_shell(part, j) / of_joint) : 0.0F;
    features[kShellReach] = reach[part * joints() + j];
    features[kShellSize] = static_cast<float>(std::sqrt(own_shell.area / total_area));
    features[kHops] = std::min(1.0F, 0.125F * static_cast<float>(tree_hops(parents, depths, joint, chosen[best])));
    features[kDepthStep] = std::clamp(0.25F * static_cast<float>(depths[j] - depths[at(chosen[best])]), -1.0F, 1.0F);
    features[kChildren] = std::min(1.0F, 0.25F * static_cast<float>(children[j]));
    features[kLeaf] = children[j] == 0 ? 1.0F : 0.0F;
    features[kDepth] = static_cast<float>(depths[j]) / static_cast<float>(deepest);
    features[kShellHeat] = share_log(heat_shares.of_shell(part, j) / own_shell.area);
    features[kShellGeodesic] = share_log(geodesic_shares.of_shell(part, j) / own_shell.area);
    features[kShellNearest] = share_log(nearest_shares.of_shell(part, j) / own_shell.area);
    features[kShellInverse] = share_log(inverse_shares.of_shell(part, j) / own_shell.area);
    const Eigen::Vector3d pivot = position_of(joint);
    const Eigen::Vector3d parent = parents[j] >= 0 ? position_of(parents[j]) : pivot;
    const double middle = (own_shell.middle - pivot).norm() / size;
    features[kJointDistance] = static_cast<float>((position - pivot).norm() / size);
    features[kParentDistance] = static_cast<float>((position - parent).norm() / size);
    features[kShellMiddle] = static_cast<float>(middle);
    features[kShellMiddleRatio] =
        static_cast<float>(std::log((middle + kMiddleFloor) / (own_shell.radius + kMiddleFloor)));
    features[kShellRadius] = static_cast<float>(own_shell.radius);
    features[kJointGap] = static_cast<float>(joint_gap[j]);
    features[kParentGap] = static_cast<float>((parent - pivot).norm() / size);
    features[kRoot] = parents[j] < 0 ? 1.0F : 0.0F;
    features[kBelow] = static_cast<float>(0.25 * std::log(below[j]));
    features[kSurfaceHeat] = share_log(of_joint / total_area);
    features[kSurfaceNearest] = share_log(nearest_shares.of_surface(j) / total_area);
  }
}

const std::array<SkinFeatureScale, kSkinPairFeatures>& skin_feature_scales() {
  static const std::array<SkinFeatureScale, kSkinPairFeatures> scales = {{
      {-6.4F, 3.3F},  {-4.0F, 2.3F},  {-6.3F, 3.3F},  {-4.0F, 2.2F}, {0.45F, 0.35F}, {0.45F, 0.3F}, {1.3F, 1.0F},
      {-0.1F, 1.6F},  {0.2F, 0.2F},   {-0.3F, 0.5F},  {0.5F, 0.5F},  {1.4F, 1.8F},   {0.5F, 0.4F},  {0.4F, 0.25F},
      {0.0F, 0.55F},  {0.25F, 0.25F}, {0.25F, 0.45F}, {0.5F, 0.3F},  {-4.6F, 2.2F},  {-3.4F, 1.5F}, {-4.75F, 2.2F},
      {-3.75F, 1.7F}, {0.5F, 0.35F},  {0.5F, 0.3F},   {0.45F, 0.3F}, {0.5F, 1.1F},   {0.3F, 0.2F},  {0.15F, 0.2F},
      {0.25F, 0.2F},  {0.1F, 0.25F},  {0.3F, 0.3F},   {-3.5F, 1.5F}, {-3.6F, 1.6F},
  }};
  return scales;
}

SkinFeatures::SkinFeatures(const Mesh& mesh, const Skeleton& skeleton, const SkinFeatureOptions& options) {
  if (options.candidates == 0) throw InputError("", "candidates", "must be at least 1");
  auto state = std::make_unique<State>();
  state->candidates = options.candidates;
  state->surface = weld_surface(mesh);
  state->bones = moving_bones(skeleton, state->surface);
  state->shells = surface_parts(state->surface);
  state->normals = outward_normals(state->surface, state->shells);
  std::tie(state->edge_offsets, state->edge_ends) = place_edges(state->surface);
  state->areas = place_areas(state->surface);
  state->size = surface_size(state->surface, state->areas);
  state->measure_tree(skeleton.parents);
  state->bind(mesh, skeleton, options.resolution);
  state->measure_joints();
  state->measure_shells();
  state->summarize();
  state_ = std::move(state);
}

SkinFeatures::~SkinFeatures() = default;

std::size_t SkinFeatures::places() const { return state_->surface.places.size(); }
std::size_t SkinFeatures::candidates() const { return state_->candidates; }
const std::vector<std::int32_t>& SkinFeatures::place_of_vertex() const { return state_->surface.of_vertex; }
const std::vector<std::int32_t>& SkinFeatures::shell_of_place() const { return state_->shells.of_place; }
const std::int32_t* SkinFeatures::neighbors_begin(std::size_t place) const {
  return state_->edge_ends.data() + state_->edge_offsets[place];
}
const std::int32_t* SkinFeatures::neighbors_end(std::size_t place) const {
  return state_->edge_ends.data() + state_->edge_offsets[place + 1];
}
const SkinWeights& SkinFeatures::heat() const { return state_->heat; }
const SkinWeights& SkinFeatures::geodesic() const { return state_->geodesic; }
const std::array<float, kSkinAssetFeatures>& SkinFeatures::asset() const { return state_->asset; }

SkinPairs SkinFeatures::pairs(const std::vector<std::int32_t>& places) const {
  SkinPairs found;
  const std::size_t width = candidates();
  found.joints.resize(places.size() * width);
  found.features.resize(places.size() * width * kSkinPairFeatures);
  parallel_for(places.size(), [&](std::size_t i) {
    state_->write(at(places[i]), &found.joints[i * width], &found.features[i * width * kSkinPairFeatures]);
  });
  return found;
}

}  // namespace anigen::rigging
