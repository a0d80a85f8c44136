#include "anigen/prepare/poses.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/geometry/ray_caster.h"

namespace anigen::prepare {

namespace {

constexpr std::size_t kPlaces = 400;
constexpr int kDirections = 32;
constexpr double kShrunk = 0.05, kStretched = 4.0, kFarthest = 1000.0, kSmallest = 1e-4;

using Vertices = std::vector<Eigen::Vector3f>;

Eigen::Vector3d corner(const Vertices& vertices, const Triangle& face, std::size_t i) {
  return vertices[static_cast<std::size_t>(face[i])].cast<double>();
}

double length(const Vertices& vertices, const Triangle& face, std::size_t edge) {
  return (corner(vertices, face, (edge + 1) % 3) - corner(vertices, face, edge)).norm();
}

// Middle over longest side of the bounding box.
double thickness(const Box& box) {
  Eigen::Vector3d sides = box.high - box.low;
  std::sort(sides.data(), sides.data() + 3);
  return sides[2] > 0.0 ? sides[1] / sides[2] : 0.0;
}

// The value below which half of the weight lies.
double weighted_median(std::vector<std::pair<double, double>> values_and_weights) {
  std::sort(values_and_weights.begin(), values_and_weights.end());
  double total = 0.0, below = 0.0;
  for (const auto& [value, weight] : values_and_weights) total += weight;
  for (const auto& [value, weight] : values_and_weights) {
    below += weight;
    if (below >= 0.5 * total) return value;
  }
  return 1.0;
}

// Signed volume, seen from the middle of the vertices, which keeps the terms small.
double volume(const Vertices& vertices, const std::vector<Triangle>& faces) {
  const Eigen::Vector3d middle = bounding_box(vertices).center();
  double sum = 0.0;
  for (const Triangle& face : faces) {
    const Eigen::Vector3d a = corner(vertices, face, 0) - middle, b = corner(vertices, face, 1) - middle;
    sum += a.dot(b.cross(corner(vertices, face, 2) - middle)) / 6.0;
  }
  return sum;
}

// Every edge is walked as often one way as the other, with vertices at one position taken as one: only then does the
// sum above not depend on where it is taken from.
bool closed(const Vertices& vertices, const std::vector<Triangle>& faces) {
  std::map<std::tuple<float, float, float>, int> ids;
  std::vector<int> id(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const Eigen::Vector3f& p = vertices[v];
    id[v] = ids.emplace(std::make_tuple(p.x(), p.y(), p.z()), static_cast<int>(ids.size())).first->second;
  }
  std::map<std::pair<int, int>, int> balance;
  for (const Triangle& face : faces) {
    for (std::size_t i = 0; i < 3; ++i) {
      const int a = id[static_cast<std::size_t>(face[i])], b = id[static_cast<std::size_t>(face[(i + 1) % 3])];
      if (a != b) balance[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return std::all_of(balance.begin(), balance.end(), [](const auto& edge) { return edge.second == 0; });
}

// Evenly over the sphere, along a spiral of golden angles.
std::array<Eigen::Vector3d, kDirections> directions() {
  std::array<Eigen::Vector3d, kDirections> result;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / kDirections, turn = 2.399963229728653 * i, r = std::sqrt(1.0 - z * z);
    result[static_cast<std::size_t>(i)] = {r * std::cos(turn), r * std::sin(turn), z};
  }
  return result;
}

Eigen::Vector3d random_direction(Rng& rng) {
  const double z = rng.uniform(-1.0, 1.0), longitude = rng.uniform(0.0, 2.0 * EIGEN_PI);
  const double radius = std::sqrt(std::max(0.0, 1.0 - z * z));
  return {radius * std::cos(longitude), radius * std::sin(longitude), z};
}

double rounded(double value) { return std::isfinite(value) ? std::round(value * 1e6) / 1e6 : 0.0; }

// Written so that a measure that is not a number is broken, too.
std::string within(const char* what, double value, double low, double high) {
  const std::string measured = std::string(what) + " " + significant(value, 3);
  if (!(value >= low)) return measured + ", at least " + significant(low, 3);
  if (!(value <= high)) return measured + ", at most " + significant(high, 3);
  return "";
}

}  // namespace

/// Flags the places that are hidden from every direction, in a pose of this size.
std::vector<bool> PoseChecks::hidden_places(const Vertices& posed, double size) const {
  static const std::array<Eigen::Vector3d, kDirections> rays = directions();
  const geometry::RayCaster caster(posed, faces_);
  std::vector<bool> result;
  for (const geometry::SurfacePoint& place : places_) {
    const Eigen::Vector3d from = geometry::position(place, posed, faces_);
    result.push_back(std::all_of(rays.begin(), rays.end(), [&](const Eigen::Vector3d& direction) {
      return caster.first_hit(from, direction, 1e-4 * size).has_value();
    }));
  }
  return result;
}

PoseChecks::PoseChecks(const Mesh& source) : vertices_(source.vertices), faces_(source.faces) {
  Rng rng(0, "places of pose checks");
  places_ = geometry::sample_surface(vertices_, faces_, kPlaces, rng);
  box_ = bounding_box(vertices_);
  hidden_ = hidden_places(vertices_, box_.longest_side());  // refuses bad vertices
  for (const Triangle& face : faces_) {
    areas_.push_back(0.5 * area_vector(vertices_, face).norm());
    total_area_ += areas_.back();
  }
  if (closed(vertices_, faces_)) {
    const double enclosed = volume(vertices_, faces_);
    // A sheet with two sides is closed, but encloses nothing that could be compared.
    if (std::abs(enclosed) > 1e-3 * std::pow(total_area_, 1.5)) volume_ = enclosed;
  }
}

PoseMeasures PoseChecks::measure(const Vertices& vertices) const {
  if (vertices.size() != vertices_.size()) throw InputError("", "vertices", "a pose must move every vertex");
  PoseMeasures result;
  const double size = box_.longest_side();
  for (const Eigen::Vector3f& vertex : vertices) {
    result.finite &= vertex.allFinite() && vertex.cast<double>().cwiseAbs().maxCoeff() <=
                                               kFarthest * size + box_.center().cwiseAbs().maxCoeff();
  }
  if (!result.finite) return result;

  std::vector<double> areas;
  std::vector<std::pair<double, double>> changes;
  double after = 0.0;
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    areas.push_back(0.5 * area_vector(vertices, faces_[f]).norm());
    after += areas[f];
    if (areas_[f] > 0.0) changes.emplace_back(areas[f] / areas_[f], areas_[f]);
  }
  result.scale = std::sqrt(weighted_median(std::move(changes)));
  if (!(result.scale > kSmallest)) return result;
  const double scale = result.scale;

  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const auto way = [&](std::size_t v) {
    return Eigen::Vector3d(vertices[v].cast<double>() / scale - vertices_[v].cast<double>());
  };
  for (std::size_t v = 0; v < vertices.size(); ++v) mean += way(v);
  mean /= static_cast<double>(vertices.size());
  double squares = 0.0;
  for (std::size_t v = 0; v < vertices.size(); ++v) squares += (way(v) - mean).squaredNorm();
  result.change = std::sqrt(squares / static_cast<double>(vertices.size())) / size;

  const Box box = bounding_box(vertices);
  result.box_ratio = box.longest_side() / (scale * size);
  const double thickness_before = thickness(box_);
  result.thickness_ratio = thickness_before > 1e-6 ? thickness(box) / thickness_before : 1.0;

  double shrunk = 0.0, stretched = 0.0;
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const Triangle& face = faces_[f];
    if (areas[f] < kShrunk * scale * scale * areas_[f]) shrunk += areas_[f];
    for (std::size_t e = 0; e < 3; ++e) {
      if (!(length(vertices, face, e) > kStretched * scale * length(vertices_, face, e))) continue;
      stretched += areas[f];
      break;
    }
  }
  if (total_area_ > 0.0) {
    result.area_ratio = after / (scale * scale * total_area_);
    result.shrunk_share = shrunk / total_area_;
  }
  if (after > 0.0) result.stretched_share = stretched / after;
  if (volume_) result.volume_ratio = volume(vertices, faces_) / (scale * scale * scale * *volume_);

  const std::vector<bool> hidden = hidden_places(vertices, box.longest_side());
  std::size_t buried = 0;
  for (std::size_t i = 0; i < hidden.size(); ++i) buried += hidden[i] && !hidden_[i] ? 1 : 0;
  result.buried_share = static_cast<double>(buried) / static_cast<double>(hidden.size());
  return result;
}

std::string to_string(PoseKind kind) { return kind == PoseKind::kAnimation ? "animation" : "random"; }

Json to_json(const Provenance& provenance) {
  Json json;
  json["source"] = provenance.source_id;
  json["seed"] = provenance.seed;
  json["k"] = provenance.k;
  json["kind"] = to_string(provenance.kind);
  if (provenance.kind == PoseKind::kAnimation) {
    json["clip"] = provenance.clip;
    json["time"] = provenance.time;
    json["second_time"] = provenance.second_time;
    json["blend"] = provenance.blend;
  }
  json["attempt"] = provenance.attempt;
  json["turned_joints"] = provenance.turned;
  json["largest_angle_degrees"] = provenance.largest_angle;
  if (const Eigen::Vector3d& factors = provenance.axis_factors; factors != Eigen::Vector3d::Ones())
    json["axis_factors"] = {factors.x(), factors.y(), factors.z()};
  json["scale"] = provenance.renormalization.scale;
  const Eigen::Vector3d& offset = provenance.renormalization.offset;
  json["offset"] = {offset.x(), offset.y(), offset.z()};
  json["measures"] = to_json(provenance.measures);
  json["rejections"] = provenance.rejections;
  json["unused_clips"] = provenance.unused_clips;
  return json;
}

JointTurns draw_turns(std::size_t joints, double probability, double max_angle, bool include_root, Rng& rng) {
  JointTurns turns;
  turns.rotations.assign(joints, Eigen::Matrix3d::Identity());
  turns.angles.assign(joints, 0.0);
  for (std::size_t j = include_root ? 0 : 1; j < joints; ++j) {
    if (!rng.chance(probability)) continue;
    const Eigen::Vector3d axis = random_direction(rng);
    turns.angles[j] = rng.uniform(0.0, max_angle);
    turns.rotations[j] = Eigen::AngleAxisd(turns.angles[j], axis.normalized()).toRotationMatrix();
  }
  return turns;
}

std::vector<Eigen::Matrix4d> turned_joints(const Skeleton& skeleton, const JointTurns& turns) {
  const std::vector<Eigen::Vector3d> joints = skeleton.positions();
  std::vector<Eigen::Matrix3d> frames(joints.size());  // G_k
  std::vector<Eigen::Vector3d> places(joints.size());  // g_k
  std::vector<Eigen::Matrix4d> world(joints.size());
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const int parent = skeleton.parents[k];
    if (parent < 0) {  // G_root = R_root, g_root = J_root
      frames[k] = turns.rotations[k];
      places[k] = joints[k];
    } else {  // G_k = G_p R_k, g_k = g_p + G_p (J_k − J_p)
      const auto p = static_cast<std::size_t>(parent);
      frames[k] = frames[p] * turns.rotations[k];
      places[k] = places[p] + frames[p] * (joints[k] - joints[p]);
    }
    world[k] = skeleton.bind[k];
    world[k].topLeftCorner<3, 3>() = frames[k] * skeleton.bind[k].topLeftCorner<3, 3>();
    world[k].topRightCorner<3, 1>() = places[k];
  }
  return world;
}

void PoseLimits::validate() const {
  const std::pair<const char*, double> all[] = {{"least_change", least_change},
                                                {"box", box[0]},
                                                {"box", box[1]},
                                                {"least_thickness", least_thickness},
                                                {"area", area[0]},
                                                {"area", area[1]},
                                                {"volume", volume[0]},
                                                {"volume", volume[1]},
                                                {"most_shrunk", most_shrunk},
                                                {"most_stretched", most_stretched},
                                                {"most_buried", most_buried}};
  for (const auto& [name, value] : all) {
    if (!(value >= 0.0)) throw InputError("", std::string("limits.") + name, "must be a number ≥ 0");
  }
  if (!(box[0] > 0.0)) throw InputError("", "limits.box", "must start above 0: a point cannot be normalised");
  if (!(least_scale > 0.0)) throw InputError("", "limits.least_scale", "must be above 0");
}

Json to_json(const PoseMeasures& measures) {
  Json json;
  json["finite"] = measures.finite;
  json["scale"] = rounded(measures.scale);
  json["change"] = rounded(measures.change);
  json["box_ratio"] = rounded(measures.box_ratio);
  json["thickness_ratio"] = rounded(measures.thickness_ratio);
  json["area_ratio"] = rounded(measures.area_ratio);
  json["volume_ratio"] = measures.volume_ratio ? Json(rounded(*measures.volume_ratio)) : Json();
  json["shrunk_share"] = rounded(measures.shrunk_share);
  json["stretched_share"] = rounded(measures.stretched_share);
  json["buried_share"] = rounded(measures.buried_share);
  return json;
}

std::string broken_limit(const PoseMeasures& measures, const PoseLimits& limits) {
  if (!measures.finite) return "not finite: a vertex is nowhere, or a thousand times as far as the object is long";
  constexpr double kAny = 1e300;
  for (std::string problem : {
           within("vanished: scale, of the source's,", measures.scale, limits.least_scale, kAny),
           within("unchanged: vertices move by", measures.change, limits.least_change, kAny),
           within("bounding box: longest side, of the source's,", measures.box_ratio, limits.box[0], limits.box[1]),
           within("bounding box: thickness, of the source's,", measures.thickness_ratio, limits.least_thickness, kAny),
           within("surface: area, of the source's,", measures.area_ratio, limits.area[0], limits.area[1]),
           within("volume: of the source's,", measures.volume_ratio.value_or(1.0), limits.volume[0], limits.volume[1]),
           within("collapsed: share of the surface with almost no area left", measures.shrunk_share, 0.0,
                  limits.most_shrunk),
           within("torn: share of the surface with an edge four times as long", measures.stretched_share, 0.0,
                  limits.most_stretched),
           within("buried: share of the surface that vanished into other parts", measures.buried_share, 0.0,
                  limits.most_buried),
       }) {
    if (!problem.empty()) return problem;
  }
  return "";
}

}  // namespace anigen::prepare
