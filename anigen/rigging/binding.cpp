#include "anigen/rigging/binding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/text.h"
#include "anigen/geometry/bones.h"
#include "anigen/rigging/surface.h"
#include "anigen/rigging/voxels.h"

namespace anigen::rigging {

StrongestInfluences::StrongestInfluences(std::size_t rows, std::size_t joints, std::size_t most)
    : most_(most == 0 ? joints : std::min(most, joints)), counts_(rows, 0), kept_(rows * most_) {}

void StrongestInfluences::offer(std::size_t row, std::size_t joint, float weight) {
  if (!(weight > 0.0F)) return;
  const Influence offered{static_cast<std::int32_t>(joint), weight};
  const auto stronger = [](const Influence& a, const Influence& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
  };
  Influence* first = kept_.data() + row * most_;
  std::uint32_t& count = counts_[row];
  if (count == most_) {
    if (!stronger(offered, first[count - 1])) return;
  } else {
    ++count;
  }
  Influence* place = first + count - 1;
  for (; place != first && stronger(offered, place[-1]); --place) *place = place[-1];
  *place = offered;
}

SkinWeights StrongestInfluences::rows() const {
  SkinWeights skin;
  skin.offsets.reserve(counts_.size() + 1);
  for (std::size_t row = 0; row < counts_.size(); ++row) {
    const Influence* first = kept_.data() + row * most_;
    skin.append_row({first, first + counts_[row]});
  }
  return skin;
}

namespace {

/// Every vertex with weight 1 on the joint whose bones (geometry::bone_segments) are nearest by straight distance; the
/// lower index of equals. The baseline of all binding: neither smooth nor aware of the surface. Needs no faces.
/// @throws InputError naming a vertex or joint that is not finite, or without joints
SkinWeights bind_to_nearest_bone(const Mesh& mesh, const Skeleton& skeleton) {
  require_joints(skeleton);
  require_finite_vertices(mesh);
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& joint : skeleton.positions()) joints.push_back(joint.cast<float>());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  SkinWeights skin;
  for (const std::size_t joint : geometry::nearest_moving_joints(mesh.vertices, segments)) {
    skin.append_row({{static_cast<std::int32_t>(joint), 1.0F}});
  }
  return skin;
}

constexpr double kNearestDistance = 1e-6;                   ///< of the mesh's size, so that no weight is infinite
constexpr std::size_t kPathMemory = std::size_t{1} << 30U;  ///< bytes, of all threads together
constexpr std::size_t kStraightJoints = 3;                  ///< of a vertex that no bone reaches

void check_geodesic_options(const GeodesicVoxelOptions& options) {
  if (!(options.falloff >= 0.0 && options.falloff <= 1.0))
    throw InputError("", "falloff", "must be between 0 and 1, not " + std::to_string(options.falloff));
  if (options.resolution < 2 || options.resolution > kMaxSolidResolution) {
    throw InputError(
        "", "resolution",
        "must be between 2 and " + std::to_string(kMaxSolidResolution) + ", not " + std::to_string(options.resolution));
  }
}

/// The weight law before it is divided by its sum: 1 / ((1 − α) d + α d²)².
double weight_at(double distance, double falloff) {
  const double d = std::max(distance, kNearestDistance);
  const double root = 1.0 / ((1.0 - falloff) * d + falloff * d * d);
  return root * root;
}

/// Sources of the paths of a joint; their lengths are `before` cells longer than the sources say.
struct JointSources {
  std::vector<PathSource> sources;
  double before = 0.0;
};

JointSources sources_inside(const SolidVoxels& solid, const MovingBones& joint) {
  JointSources found;
  for (const BoneLine& line : joint.lines) {
    const BoneLine measured{solid.block.measured(line.start), solid.block.measured(line.end)};
    bool entered = false;
    walk_line(solid.block, line, [&](const std::vector<std::uint32_t>& cells) {
      bool any = false;
      for (const std::uint32_t cell : cells) {
        if (!solid.is_solid(cell)) continue;
        any = true;
        const double distance = distance_to({{measured}, false}, solid.block.center(cell));
        found.sources.push_back({cell, static_cast<float>(distance)});
      }
      entered = entered || any;
      return any || !(joint.is_tip && entered);
    });
  }
  return found;
}

/// For bones that lie outside: the walls that are less than a cell farther away than the nearest one.
JointSources sources_on_walls(const SolidVoxels& solid, const MovingBones& joint) {
  MovingBones measured = joint;
  for (BoneLine& line : measured.lines) line = {solid.block.measured(line.start), solid.block.measured(line.end)};
  std::vector<double> distances;
  distances.reserve(solid.walls.size());
  for (const std::uint32_t wall : solid.walls) distances.push_back(distance_to(measured, solid.block.center(wall)));
  JointSources found;
  found.before = *std::min_element(distances.begin(), distances.end());
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const double farther = distances[i] - found.before;
    if (farther < 1.0) found.sources.push_back({solid.walls[i], static_cast<float>(farther)});
  }
  return found;
}

/// Cells whose centre is at most 1.5 away along an axis: its own and one to each side, or two to each side of a border.
std::array<int, 2> cells_around(double coordinate) {
  constexpr double kTie = 1e-9;
  return {static_cast<int>(std::ceil(coordinate - 2.0 - kTie)), static_cast<int>(std::floor(coordinate + 1.0 + kTie))};
}

/// The shortest way to a point over its cell and the solid ones around it, in cells; infinite when there is none.
double distance_at(const Eigen::Vector3d& point, const SolidVoxels& solid, const std::vector<float>& distances) {
  double nearest = std::numeric_limits<double>::infinity();
  const Eigen::Vector3d limit(solid.block.size[0], solid.block.size[1], solid.block.size[2]);
  if (!((point.array() >= 0.0).all() && (point.array() < limit.array()).all())) return nearest;
  const auto [x0, x1] = cells_around(point.x());
  const auto [y0, y1] = cells_around(point.y());
  const auto [z0, z1] = cells_around(point.z());
  for (int i = x0; i <= x1; ++i) {
    for (int j = y0; j <= y1; ++j) {
      for (int k = z0; k <= z1; ++k) {
        if (!solid.block.holds(i, j, k)) continue;
        const auto distance = static_cast<double>(distances[solid.block.index(i, j, k)]);
        if (!(distance >= 0.0 && distance < nearest)) continue;
        nearest = std::min(nearest, distance + (point - Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5)).norm());
      }
    }
  }
  return nearest;
}

/// The i-th joint to work on: steps of about 0.618 of them all, so that the first few lie all over the skeleton, and
/// bounds are low from early on.
std::size_t spread_out(std::size_t i, std::size_t joints) {
  std::size_t step = std::max(std::size_t{1}, static_cast<std::size_t>(0.618 * static_cast<double>(joints)));
  while (std::gcd(step, joints) != 1) ++step;
  return i * step % joints;
}

/// Geodesic weights of all places, joints a batch at a time: memory is what a batch takes.
void offer_geodesic(const WeldedSurface& surface, const SolidVoxels& solid, const std::vector<MovingBones>& bones,
                    const GeodesicVoxelOptions& options, StrongestInfluences& influences) {
  const std::size_t places = surface.places.size();
  const std::size_t each = sizeof(float) * (solid.states.size() + places);
  const std::size_t batch = std::min(bones.size(), std::clamp(kPathMemory / each, std::size_t{1}, at(thread_count())));
  std::vector<VoxelPaths> paths(batch, VoxelPaths(solid));
  std::vector<std::vector<float>> weights(batch, std::vector<float>(places));
  PathBounds bounds(solid, options.most_influences < bones.size() ? options.most_influences : 0);
  for (std::size_t first = 0; first < bones.size(); first += batch) {
    const std::size_t count = std::min(batch, bones.size() - first);
    std::vector<std::pair<const std::vector<float>*, double>> finished(count);
    parallel_for(count, [&](std::size_t b) {
      const MovingBones& joint = bones[spread_out(first + b, bones.size())];
      JointSources from = sources_inside(solid, joint);
      if (from.sources.empty()) from = sources_on_walls(solid, joint);
      const std::vector<float>& distances = paths[b].run(from.sources, bounds, from.before);
      finished[b] = {&distances, from.before};
      for (std::size_t p = 0; p < places; ++p) {
        const double cells = distance_at(solid.block.measured(surface.places[p]), solid, distances);
        const double distance = (from.before + cells) / solid.block.cells_per_unit;
        weights[b][p] = std::isfinite(distance) ? static_cast<float>(weight_at(distance, options.falloff)) : 0.0F;
      }
    });
    bounds.add(finished);
    for (std::size_t p = 0; p < places; ++p) {
      for (std::size_t b = 0; b < count; ++b) influences.offer(p, spread_out(first + b, bones.size()), weights[b][p]);
    }
  }
}

void offer_straight(const Eigen::Vector3d& place, std::size_t row, const std::vector<MovingBones>& bones,
                    double falloff, StrongestInfluences& influences) {
  std::vector<std::pair<double, std::size_t>> nearest;
  nearest.reserve(bones.size());
  for (std::size_t j = 0; j < bones.size(); ++j) nearest.emplace_back(distance_to(bones[j], place), j);
  const std::size_t count = std::min(kStraightJoints, nearest.size());
  std::partial_sort(nearest.begin(), nearest.begin() + static_cast<std::ptrdiff_t>(count), nearest.end());
  for (std::size_t i = 0; i < count; ++i) {
    // By the nearest one, since far away all of them are next to nothing.
    const double share = weight_at(nearest[i].first, falloff) / weight_at(nearest[0].first, falloff);
    influences.offer(row, nearest[i].second, static_cast<float>(share));
  }
}

const Words<SkinBinding> kBindingWords = {
    {SkinBinding::kNearest, "nearest"}, {SkinBinding::kGeodesicVoxels, "geovoxel"}, {SkinBinding::kHeat, "heat"}};

}  // namespace

SkinWeights bind_by_geodesic_voxels(const Mesh& mesh, const Skeleton& skeleton, const GeodesicVoxelOptions& options) {
  check_geodesic_options(options);
  const WeldedSurface surface = weld_surface(mesh);
  const std::vector<MovingBones> bones = moving_bones(skeleton, surface);
  StrongestInfluences influences(surface.places.size(), bones.size(), options.most_influences);
  if (surface.has_extent) {
    const SolidVoxels solid = solid_voxels(surface, bones, options.resolution, options.validate_solid);
    offer_geodesic(surface, solid, bones, options, influences);
  }
  for (std::size_t p = 0; p < surface.places.size(); ++p) {
    if (influences.empty(p)) offer_straight(surface.places[p], p, bones, options.falloff, influences);
  }
  return rows_of_vertices(influences.rows(), surface);
}

std::string to_string(SkinBinding binding) { return word_of(kBindingWords, binding); }

SkinBinding parse_skin_binding(const std::string& word) {
  std::string words;
  for (const auto& [binding, known] : kBindingWords) {
    if (word == known) return binding;
    words += words.empty() ? known : std::string(", ") + known;
  }
  throw InputError("", "--skin", "\"" + word + "\" is none of " + words);
}

SkinWeights bind(SkinBinding binding, const Mesh& mesh, const Skeleton& skeleton, const BindingOptions& options) {
  switch (binding) {
    case SkinBinding::kNearest:
      return bind_to_nearest_bone(mesh, skeleton);
    case SkinBinding::kGeodesicVoxels:
      return bind_by_geodesic_voxels(mesh, skeleton, options.geodesic);
    case SkinBinding::kHeat:
      return bind_by_heat(mesh, skeleton, options.heat);
  }
  throw Error("an unknown skin binding");
}

}  // namespace anigen::rigging
