#include "anigen/rigging/bone_heat.h"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/rigging/binding.h"

namespace anigen::rigging {

namespace {

/// The negative Laplace–Beltrami operator of a welded surface, −Δ = M⁻¹ L, in the unit frame. L is positive
/// semidefinite: (L w)_i = Σ_j c_ij (w_i − w_j), and L of a constant is 0.
struct CotangentLaplacian {
  struct Edge {
    std::int32_t a, b;   ///< places, a < b
    double conductance;  ///< c_ab = (cot α + cot β) / 2, summed over the faces at the edge, of which there may be any
                         ///< number
  };
  std::vector<Edge> edges;    ///< by (a, b), once each
  std::vector<double> areas;  ///< [P] diagonal of M: a third of the faces around each place
};

constexpr double kLargestCotangent = 1e3;

/// Of the angles at the three corners.
std::array<double, 3> cotangents(const std::array<Eigen::Vector3d, 3>& corners, double twice_area) {
  std::array<double, 3> result{};
  bool is_sliver = !(twice_area > 0.0);
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d &p = corners[k], &q = corners[(k + 1) % 3], &r = corners[(k + 2) % 3];
    const double dot = (q - p).dot(r - p);
    result[k] = dot / twice_area;
    if (!(twice_area > 0.0)) result[k] = dot > 0.0 ? kLargestCotangent : 0.0;
    is_sliver = is_sliver || !(std::abs(result[k]) <= kLargestCotangent);
  }
  if (is_sliver) {
    for (double& cotangent : result) cotangent = std::clamp(cotangent, 0.0, kLargestCotangent);
  }
  return result;
}

/// Faces with an angle below about 0.06° would drown the others in rounding: their cotangents are cut off at 1000 and
/// the negative ones left out, which keeps L semidefinite and what they join joined.
CotangentLaplacian cotangent_laplacian(const WeldedSurface& surface) {
  CotangentLaplacian laplacian;
  laplacian.areas.assign(surface.places.size(), 0.0);
  laplacian.edges.reserve(3 * surface.faces.size());
  for (const Triangle& face : surface.faces) {
    const std::array<Eigen::Vector3d, 3> corners = {surface.places[at(face[0])], surface.places[at(face[1])],
                                                    surface.places[at(face[2])]};
    const double twice_area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).norm();
    const std::array<double, 3> opposite = cotangents(corners, twice_area);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(face[(k + 1) % 3], face[(k + 2) % 3]);
      laplacian.edges.push_back({low, high, 0.5 * opposite[k]});
      laplacian.areas[at(face[k])] += twice_area / 6.0;
    }
  }
  // Stable, so that sums are taken in the order of faces.
  std::vector<CotangentLaplacian::Edge>& edges = laplacian.edges;
  std::stable_sort(edges.begin(), edges.end(),
                   [](const auto& e, const auto& f) { return e.a != f.a ? e.a < f.a : e.b < f.b; });
  std::size_t kept = 0;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (kept > 0 && edges[kept - 1].a == edges[e].a && edges[kept - 1].b == edges[e].b) {
      edges[kept - 1].conductance += edges[e].conductance;
    } else {
      edges[kept++] = edges[e];
    }
  }
  edges.resize(kept);
  return laplacian;
}

constexpr double kEquallyNear = 1.0001;
constexpr double kSkinDepth = 0.002;   ///< how deep below the surface things still count as on it
constexpr double kLeastCosine = 0.5;   ///< between the way from the bone and the normal
constexpr double kLeastFacing = 0.05;  ///< a bone behind the surface is at most so many times farther: 1 / 0.05
constexpr double kFarthestSeen = 1e3;  ///< rays are in single precision
constexpr double kGrazing = 1e-5;      ///< of a way, at both ends, where it meets nothing (Blender's margin)
constexpr double kPastFace = 1e-6;     ///< the least step from one face to the next

std::vector<Eigen::Vector3f> rounded(const WeldedSurface& surface) {
  std::vector<Eigen::Vector3f> vertices;
  vertices.reserve(surface.places.size());
  // Places without faces may lie anywhere, and are not part of the surface.
  for (const Eigen::Vector3d& place : surface.places)
    vertices.push_back(place.cwiseMax(-1.0).cwiseMin(1.0).cast<float>());
  return vertices;
}

/// Surface in at least five of the six directions along the axes: inside, also near a hole.
bool is_enclosed(const Eigen::Vector3d& point, const geometry::RayCaster& caster) {
  int hits = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0})
      hits += caster.first_hit(point, sign * Eigen::Vector3d::Unit(axis)).has_value();
  }
  return hits >= 5;
}

/// Ends a made-up line where it comes out of the body, of whose parts it may cross several: a little before, so that
/// nobody sees it from outside.
void end_inside(BoneLine& line, const geometry::RayCaster& caster) {
  const Eigen::Vector3d along = line.end - line.start;
  const double length = along.norm();
  if (!(length > 0.0) || line.start.cwiseAbs().maxCoeff() > kFarthestSeen) return;
  constexpr double kStep = 2.0 * kSkinDepth;
  for (double reached = 0.0; reached < length;) {
    const std::optional<double> hit = caster.first_hit(line.start, along, reached);
    if (!hit || *hit >= length) return;
    if (!is_enclosed(line.start + along * ((*hit + kStep) / length), caster)) {
      line.end = line.start + along * (std::max(0.0, *hit - kStep) / length);
      return;
    }
    reached = *hit + kStep;
  }
}

/// Parts that were wound inward: closed, and of a negative volume. A curved sheet has the side that it was given.
std::vector<char> inward_parts(const WeldedSurface& surface, const SurfaceParts& parts) {
  std::vector<std::array<std::int32_t, 2>> edges;
  edges.reserve(3 * surface.faces.size());
  for (const Triangle& face : surface.faces) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(face[k], face[(k + 1) % 3]);
      edges.push_back({low, high});
    }
  }
  std::sort(edges.begin(), edges.end());
  std::vector<char> inward(parts.size());
  for (std::size_t part = 0; part < inward.size(); ++part) inward[part] = parts.volumes[part] < 0.0;
  for (std::size_t e = 0; e < edges.size();) {
    const auto end = std::upper_bound(edges.begin() + static_cast<std::ptrdiff_t>(e), edges.end(), edges[e]);
    const auto next = static_cast<std::size_t>(end - edges.begin());
    if (next == e + 1) inward[at(parts.of_place[at(edges[e][0])])] = 0;
    e = next;
  }
  return inward;
}

/// Of a face, out of its part as far as that is closed.
Eigen::Vector3d front_normal(const WeldedSurface& surface, const SurfaceParts& parts, const std::vector<char>& inward,
                             const Triangle& face) {
  const Eigen::Vector3d &a = surface.places[at(face[0])], &b = surface.places[at(face[1])],
                        &c = surface.places[at(face[2])];
  return inward[at(parts.of_place[at(face[0])])] != 0 ? (c - a).cross(b - a) : (b - a).cross(c - a);
}

/// Of every place: means of the faces around it by their angles, which do not depend on how a flat side is cut into
/// triangles. Blender counts every face once.
std::vector<Eigen::Vector3d> mean_normals(const WeldedSurface& surface, const SurfaceParts& parts,
                                          const std::vector<char>& inward) {
  std::vector<Eigen::Vector3d> normals(surface.places.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : surface.faces) {
    const Eigen::Vector3d normal = front_normal(surface, parts, inward, face).stableNormalized();
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d& corner = surface.places[at(face[k])];
      const Eigen::Vector3d to_next = surface.places[at(face[(k + 1) % 3])] - corner;
      const Eigen::Vector3d to_last = surface.places[at(face[(k + 2) % 3])] - corner;
      normals[at(face[k])] += std::atan2(to_next.cross(to_last).norm(), to_next.dot(to_last)) * normal;
    }
  }
  for (Eigen::Vector3d& normal : normals) normal.stableNormalize();
  return normals;
}

/// The point of a joint's lines nearest to another.
Eigen::Vector3d nearest_point(const MovingBones& joint, const Eigen::Vector3d& place) {
  Eigen::Vector3d nearest = joint.lines.front().start;
  double least = std::numeric_limits<double>::infinity();
  for (const BoneLine& line : joint.lines) {
    const double t = geometry::nearest_on_segment(place, line.start, line.end);
    const Eigen::Vector3d point = line.start + t * (line.end - line.start);
    if ((point - place).norm() < least) {
      least = (point - place).norm();
      nearest = point;
    }
  }
  return nearest;
}

struct Visibility {
  const geometry::RayCaster* caster;
  const WeldedSurface* surface;
  const std::vector<Eigen::Vector3d>* normals;
  const SurfaceParts* parts;
  const std::vector<char>& inward;
  HeatForm form;

  /// Between a place's normal and the way to it from elsewhere; on sheets whichever side is nearer to it.
  double cosine(std::size_t place, const Eigen::Vector3d& way) const {
    const double length = way.norm();
    if (!(length > 0.0)) return 1.0;
    const double cosine = (*normals)[place].dot(way) / length;
    const bool has_sides = form == HeatForm::kBlender || parts->encloses_space(at(parts->of_place[place]));
    return has_sides ? cosine : std::abs(cosine);
  }

  /// Distance from a bone as the surface faces.
  double measure(std::size_t place, const Eigen::Vector3d& way) const {
    return way.norm() / std::max(kLeastFacing, 0.5 * (1.0 + cosine(place, way)));
  }

  bool sees(std::size_t place, const Eigen::Vector3d& position, const Eigen::Vector3d& bone) const {
    const Eigen::Vector3d outward = position - bone;
    const double distance = outward.norm();
    if (distance <= kSkinDepth) return true;
    if (distance > kFarthestSeen) return false;
    if (form == HeatForm::kBlender) return !enters(position, -outward);
    if (!(cosine(place, outward) > kLeastCosine)) return false;
    const std::optional<double> hit = caster->first_hit(position, -outward, std::min(kSkinDepth, 0.5 * distance));
    return !hit || *hit >= distance - kSkinDepth;
  }

  /// True when the way to a bone meets the front of a face.
  bool enters(const Eigen::Vector3d& start, const Eigen::Vector3d& way) const {
    const double distance = way.norm(), margin = kGrazing * distance;
    for (double reached = margin; reached < distance - margin;) {
      const std::optional<geometry::RayCaster::Hit> hit = caster->first_face(start, way, reached);
      if (!hit || hit->distance >= distance - margin) return false;
      if (front_normal(*surface, *parts, inward, surface->faces[hit->face]).dot(way) < 0.0) return true;
      reached = hit->distance + std::max(kPastFace, margin);
    }
    return false;
  }
};

constexpr double kNearestSource = 1e-4;  ///< H is not infinite on a bone
/// Places need an area for heat to enter; of those without faces it does not matter how much.
constexpr double kLeastArea = 1e-12;
/// Heat that a place takes from a nearest bone that it does not see, as a part of what it would take: next to nothing
/// where heat comes from nearby, and what decides far away from any place that sees a bone.
constexpr double kFaintHeat = 0.01;
constexpr double kLeastSeen = 0.1;  ///< of a part's area, or all of it is warmed as if it saw
constexpr double kLeastWeight = 1e-8;

using HeatMatrix = Eigen::SparseMatrix<double>;
using HeatSolver = Eigen::SimplicialLDLT<HeatMatrix, Eigen::Lower, Eigen::AMDOrdering<int>>;

/// Points at which a joint's heat enters.
struct Inflow {
  std::int32_t place;
  double heat;
};

struct HeatProblem {
  HeatMatrix matrix;                         ///< [P, P], lower half
  std::vector<std::vector<Inflow>> inflows;  ///< [J]
};

/// Parts of which enough sees a bone.
std::vector<char> seeing_parts(const SurfaceParts& parts, const std::vector<HeatSource>& sources,
                               const std::vector<double>& areas) {
  std::vector<double> all(parts.size(), 0.0), seeing(parts.size(), 0.0);
  for (std::size_t p = 0; p < sources.size(); ++p) {
    const std::size_t part = at(parts.of_place[p]);
    const std::vector<bool>& visible = sources[p].visible;
    all[part] += areas[p];
    if (std::find(visible.begin(), visible.end(), true) != visible.end()) seeing[part] += areas[p];
  }
  std::vector<char> result(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i) result[i] = seeing[i] > kLeastSeen * all[i];
  return result;
}

HeatProblem heat_problem(const WeldedSurface& surface, const std::vector<MovingBones>& bones,
                         const BoneHeatOptions& options) {
  // M (−Δ + H) w_j = M H p_j, times the areas M so that the matrix L + M H is symmetric.
  const SurfaceParts parts = surface_parts(surface);
  const std::vector<HeatSource> sources = heat_sources(surface, parts, bones, options.form);
  const CotangentLaplacian laplacian = cotangent_laplacian(surface);
  const std::vector<char> sees = seeing_parts(parts, sources, laplacian.areas);
  HeatProblem problem;
  problem.inflows.resize(bones.size());
  std::vector<double> diagonal(sources.size(), 0.0);
  for (std::size_t p = 0; p < sources.size(); ++p) {
    const bool is_blender = options.form == HeatForm::kBlender;
    const double d = std::max(is_blender ? sources[p].measure : sources[p].distance, kNearestSource);
    const double full = std::max(laplacian.areas[p], kLeastArea) * options.heat / (d * d);  // (M H)_pp of one seen bone
    for (std::size_t i = 0; i < sources[p].joints.size(); ++i) {
      const bool counts = sources[p].visible[i] || (!is_blender && sees[at(parts.of_place[p])] == 0);
      const double inflow = counts ? full : kFaintHeat * full;
      problem.inflows[at(sources[p].joints[i])].push_back({static_cast<std::int32_t>(p), inflow});
      diagonal[p] += inflow;
    }
  }
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(laplacian.edges.size() + diagonal.size());
  for (const CotangentLaplacian::Edge& edge : laplacian.edges) {  // L: −c_ab beside, Σ c_ab on the diagonal
    entries.emplace_back(edge.b, edge.a, -edge.conductance);
    diagonal[at(edge.a)] += edge.conductance;
    diagonal[at(edge.b)] += edge.conductance;
  }
  for (std::size_t p = 0; p < diagonal.size(); ++p)
    entries.emplace_back(static_cast<int>(p), static_cast<int>(p), diagonal[p]);
  const auto places = static_cast<Eigen::Index>(sources.size());
  problem.matrix.resize(places, places);
  problem.matrix.setFromTriplets(entries.begin(), entries.end());
  return problem;
}

/// Weights of every joint, joints a batch at a time: memory is what a batch takes.
void offer_heat(const HeatProblem& problem, StrongestInfluences& influences) {
  const HeatSolver solver(problem.matrix);
  if (solver.info() != Eigen::Success) throw Error("the heat equation of this mesh cannot be factorised");
  const std::size_t joints = problem.inflows.size(), batch = at(thread_count());
  std::vector<Eigen::VectorXd> weights(batch);
  for (std::size_t first = 0; first < joints; first += batch) {
    const std::size_t count = std::min(batch, joints - first);
    parallel_for(count, [&](std::size_t b) {
      weights[b].setZero(problem.matrix.rows());
      for (const Inflow& inflow : problem.inflows[first + b]) weights[b][inflow.place] = inflow.heat;
      if (!problem.inflows[first + b].empty()) weights[b] = solver.solve(weights[b]);
    });
    for (Eigen::Index p = 0; p < problem.matrix.rows(); ++p) {
      for (std::size_t b = 0; b < count; ++b) {
        const double weight = std::min(weights[b][p], 1.0);
        if (weight >= kLeastWeight)
          influences.offer(static_cast<std::size_t>(p), first + b, static_cast<float>(weight));
      }
    }
  }
}

std::size_t nearest_joint(const std::vector<MovingBones>& bones, const Eigen::Vector3d& place) {
  std::vector<double> distances;
  for (const MovingBones& joint : bones) distances.push_back(distance_to(joint, place));
  return static_cast<std::size_t>(std::min_element(distances.begin(), distances.end()) - distances.begin());
}

}  // namespace

std::vector<HeatSource> heat_sources(const WeldedSurface& surface, const SurfaceParts& parts,
                                     std::vector<MovingBones> bones, HeatForm form) {
  const geometry::RayCaster caster(rounded(surface), surface.faces);
  for (MovingBones& joint : bones) {
    if (joint.is_tip && form == HeatForm::kPublished) end_inside(joint.lines.front(), caster);
  }
  const std::vector<char> inward = inward_parts(surface, parts);
  const std::vector<Eigen::Vector3d> normals =
      form == HeatForm::kBlender ? mean_normals(surface, parts, inward) : outward_normals(surface, parts);
  const Visibility visibility{&caster, &surface, &normals, &parts, inward, form};
  std::vector<HeatSource> sources(surface.places.size());
  parallel_for(sources.size(), [&](std::size_t p) {
    const Eigen::Vector3d& place = surface.places[p];
    std::vector<Eigen::Vector3d> points;
    std::vector<double> measures;
    points.reserve(bones.size());
    measures.reserve(bones.size());
    for (const MovingBones& joint : bones) {
      points.push_back(nearest_point(joint, place));
      measures.push_back(visibility.measure(p, place - points.back()));
    }
    HeatSource& source = sources[p];
    const auto least = std::min_element(measures.begin(), measures.end());
    source.measure = *least;
    source.distance = (place - points[static_cast<std::size_t>(least - measures.begin())]).norm();
    for (std::size_t j = 0; j < bones.size(); ++j) {
      if (measures[j] > kEquallyNear * *least) continue;
      source.joints.push_back(static_cast<std::int32_t>(j));
      source.visible.push_back(visibility.sees(p, place, points[j]));
    }
  });
  return sources;
}

BoneHeatOptions fitted_heat(std::size_t most_influences) {
  BoneHeatOptions options;
  options.heat = 4.0;
  options.form = HeatForm::kBlender;
  options.most_influences = most_influences;
  return options;
}

SkinWeights bind_by_heat(const Mesh& mesh, const Skeleton& skeleton, const BoneHeatOptions& options) {
  if (!(options.heat > 0.0 && std::isfinite(options.heat)))
    throw InputError("", "heat", "must be a finite number above 0, not " + std::to_string(options.heat));
  const WeldedSurface surface = weld_surface(mesh);
  std::vector<MovingBones> bones = moving_bones(skeleton, surface);
  join_lines(bones);
  StrongestInfluences influences(surface.places.size(), bones.size(), options.most_influences);
  if (surface.has_extent) offer_heat(heat_problem(surface, bones, options), influences);
  for (std::size_t p = 0; p < surface.places.size(); ++p) {
    if (influences.empty(p)) influences.offer(p, nearest_joint(bones, surface.places[p]), 1.0F);
  }
  return rows_of_vertices(influences.rows(), surface);
}

}  // namespace anigen::rigging
