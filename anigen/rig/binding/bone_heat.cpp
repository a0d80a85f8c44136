#include "anigen/rig/binding/bone_heat.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/rig/binding/cotangent_laplacian.h"
#include "anigen/rig/binding/heat_sources.h"
#include "anigen/rig/binding/strongest_influences.h"

namespace anigen::rig {
namespace {

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

/// Where a joint's heat comes in.
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

HeatProblem heat_problem(const WeldedSurface& surface, const std::vector<MovingBones>& bones, double heat) {
  const SurfaceParts parts = surface_parts(surface);
  const std::vector<HeatSource> sources = heat_sources(surface, parts, bones);
  const CotangentLaplacian laplacian = cotangent_laplacian(surface);
  const std::vector<char> sees = seeing_parts(parts, sources, laplacian.areas);
  HeatProblem problem;
  problem.inflows.resize(bones.size());
  std::vector<double> diagonal(sources.size(), 0.0);
  for (std::size_t p = 0; p < sources.size(); ++p) {
    const double d = std::max(sources[p].distance, kNearestSource);
    const double full = std::max(laplacian.areas[p], kLeastArea) * heat / (d * d);
    for (std::size_t i = 0; i < sources[p].joints.size(); ++i) {
      const bool counts = sources[p].visible[i] || sees[at(parts.of_place[p])] == 0;
      const double inflow = counts ? full : kFaintHeat * full;
      problem.inflows[at(sources[p].joints[i])].push_back({static_cast<std::int32_t>(p), inflow});
      diagonal[p] += inflow;
    }
  }
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(laplacian.edges.size() + diagonal.size());
  for (const CotangentLaplacian::Edge& edge : laplacian.edges) {
    entries.emplace_back(edge.b, edge.a, -edge.conductance);
    diagonal[at(edge.a)] += edge.conductance;
    diagonal[at(edge.b)] += edge.conductance;
  }
  for (std::size_t p = 0; p < diagonal.size(); ++p) {
    entries.emplace_back(static_cast<int>(p), static_cast<int>(p), diagonal[p]);
  }
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

SkinWeights bind_by_heat(const Mesh& mesh, const Skeleton& skeleton, const BoneHeatOptions& options) {
  if (!(options.heat > 0.0 && std::isfinite(options.heat))) {
    throw InputError("", "heat", "must be a finite number above 0, not " + std::to_string(options.heat));
  }
  const WeldedSurface surface = weld_surface(mesh);
  std::vector<MovingBones> bones = moving_bones(skeleton, surface);
  join_lines(bones);
  StrongestInfluences influences(surface.places.size(), bones.size(), options.most_influences);
  if (surface.has_extent) offer_heat(heat_problem(surface, bones, options.heat), influences);
  for (std::size_t p = 0; p < surface.places.size(); ++p) {
    if (influences.empty(p)) influences.offer(p, nearest_joint(bones, surface.places[p]), 1.0F);
  }
  return rows_of_vertices(influences.rows(), surface);
}

}  // namespace anigen::rig
