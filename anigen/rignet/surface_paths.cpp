#include "anigen/rignet/surface_paths.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <queue>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/simplify.h"
#include "anigen/nn/init.h"
#include "anigen/rigging/surface.h"

namespace anigen::rignet {

namespace {

constexpr double kTolerance = 1.5;     // of the number of vertices asked for, before the surface is torn
constexpr double kFirstCells = 128.0;  // along the longest side, of the grid then
constexpr double kFewerCells = 0.85;

struct Surface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
};

// The vertices that faces name, in order.
Surface without_strays(const Surface& surface) {
  std::vector<std::int32_t> number(surface.vertices.size(), -1);
  for (const Triangle& face : surface.faces) {
    for (const std::int32_t corner : face) number[at(corner)] = 0;
  }
  Surface kept;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] < 0) continue;
    number[v] = static_cast<std::int32_t>(kept.vertices.size());
    kept.vertices.push_back(surface.vertices[v]);
  }
  for (const Triangle& face : surface.faces) {
    kept.faces.push_back({number[at(face[0])], number[at(face[1])], number[at(face[2])]});
  }
  return kept;
}

Surface welded(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  Mesh mesh;
  mesh.vertices = vertices;
  mesh.faces = faces;
  const rigging::WeldedSurface whole = rigging::weld_surface(mesh);
  if (!whole.has_extent || whole.faces.empty()) throw InputError("", "faces", "the mesh has no extent");
  Surface surface;
  for (const Eigen::Vector3d& place : whole.places)
    surface.vertices.emplace_back((whole.center + whole.size * place).cast<float>());
  surface.faces = whole.faces;
  return without_strays(surface);
}

// Vertices of one cell become one at their mean; faces that no longer have three are gone.
Surface snapped(const Surface& surface, double cell) {
  std::map<std::array<std::int64_t, 3>, std::int32_t> cells;
  std::vector<std::int32_t> number;
  std::vector<Eigen::Vector3d> sums;
  std::vector<double> counts;
  for (const Eigen::Vector3f& vertex : surface.vertices) {
    const auto key = [&](int axis) { return std::llround(std::floor(vertex[axis] / cell)); };
    const auto [place, is_new] = cells.try_emplace({key(0), key(1), key(2)}, static_cast<std::int32_t>(sums.size()));
    if (is_new) {
      sums.emplace_back(Eigen::Vector3d::Zero());
      counts.push_back(0.0);
    }
    sums[at(place->second)] += vertex.cast<double>();
    counts[at(place->second)] += 1.0;
    number.push_back(place->second);
  }
  Surface coarse;
  for (std::size_t v = 0; v < sums.size(); ++v) coarse.vertices.emplace_back((sums[v] / counts[v]).cast<float>());
  for (const Triangle& face : surface.faces) {
    const Triangle corners = {number[at(face[0])], number[at(face[1])], number[at(face[2])]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    coarse.faces.push_back(corners);
  }
  return without_strays(coarse);
}

Surface coarsened(Surface surface, double longest_side, std::size_t most_vertices) {
  if (surface.vertices.size() <= most_vertices) return surface;
  const double share = static_cast<double>(most_vertices) / static_cast<double>(surface.vertices.size());
  const auto faces = static_cast<std::size_t>(share * static_cast<double>(surface.faces.size()));
  const Mesh mesh = geometry::simplify(surface.vertices, surface.faces, std::max<std::size_t>(faces, 4)).mesh;
  Surface coarse = without_strays({mesh.vertices, mesh.faces});
  const auto enough = static_cast<std::size_t>(kTolerance * static_cast<double>(most_vertices));
  for (double cells = kFirstCells; coarse.vertices.size() > enough && cells >= 1.0; cells *= kFewerCells) {
    Surface torn = snapped(surface, longest_side / cells);
    if (torn.faces.empty()) break;
    coarse = std::move(torn);
  }
  return coarse;
}

constexpr int kSolidResolution = 88;
constexpr double kWayStep = 0.01;

constexpr std::size_t kNearestLinks = 5;
constexpr float kLeastNormalCosine = -0.5F;
constexpr std::size_t kDrawsPerSample = 4;
constexpr double kSpacing = 0.7;  // of samples, in roots of their share of the area: fewer than this leaves room for

using Queue =
    std::priority_queue<std::pair<double, std::int32_t>, std::vector<std::pair<double, std::int32_t>>, std::greater<>>;

struct Cloud {
  std::vector<Eigen::Vector3f> points, normals;
};

Eigen::Vector3f corner_cross(const RignetMesh& mesh, const Triangle& face) {
  const Eigen::Vector3f& a = mesh.vertices[at(face[0])];
  return (mesh.vertices[at(face[1])] - a).cross(mesh.vertices[at(face[2])] - a);
}

// Uniform draws, those too near to an earlier one left out: a Poisson-disk sample.
void add_samples(const RignetMesh& mesh, std::size_t samples, std::uint64_t seed, Cloud& cloud) {
  double area = 0.0;
  for (const Triangle& face : mesh.faces) area += 0.5 * corner_cross(mesh, face).norm();
  const double apart = kSpacing * std::sqrt(area / static_cast<double>(std::max<std::size_t>(samples, 1)));
  const auto least = static_cast<float>(apart * apart);
  Rng rng(seed, "rignet surface samples");
  const std::size_t first = cloud.points.size();
  for (const auto& draw : geometry::sample_surface(mesh.vertices, mesh.faces, kDrawsPerSample * samples, rng)) {
    if (cloud.points.size() == first + samples) break;
    const Eigen::Vector3f place = geometry::position(draw, mesh.vertices, mesh.faces).cast<float>();
    bool is_free = true;
    for (std::size_t i = first; is_free && i < cloud.points.size(); ++i)
      is_free = (cloud.points[i] - place).squaredNorm() >= least;
    if (!is_free) continue;
    cloud.points.push_back(place);
    cloud.normals.push_back(corner_cross(mesh, mesh.faces[at(draw.face)]).normalized());
  }
}

// Pairs of each point with its nearest ones of compatible normals.
void add_nearest(const Cloud& cloud, std::vector<std::pair<std::int32_t, std::int32_t>>& pairs) {
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    std::array<std::pair<float, std::int32_t>, kNearestLinks> best;
    best.fill({std::numeric_limits<float>::infinity(), -1});
    for (std::size_t j = 0; j < cloud.points.size(); ++j) {
      const float squared = (cloud.points[i] - cloud.points[j]).squaredNorm();
      if (j == i || squared >= best.back().first) continue;
      if (cloud.normals[i].dot(cloud.normals[j]) <= kLeastNormalCosine) continue;
      best.back() = {squared, static_cast<std::int32_t>(j)};
      for (std::size_t k = kNearestLinks - 1; k > 0 && best[k].first < best[k - 1].first; --k)
        std::swap(best[k], best[k - 1]);
    }
    for (const auto& [squared, j] : best) {
      if (j >= 0) pairs.emplace_back(static_cast<std::int32_t>(i), j);
    }
  }
}

}  // namespace

RignetFrame RignetFrame::of(const std::vector<Eigen::Vector3f>& vertices) {
  RignetFrame frame;
  frame.anymate_ = anymate::AnymateFrame::of(vertices);
  frame.floor_ = frame.anymate_.into(bounding_box(vertices).low).y();
  return frame;
}

Eigen::Vector3d RignetFrame::from_anymate(const Eigen::Vector3d& point) const {
  return 0.5 * (point - Eigen::Vector3d(0.0, floor_, 0.0));
}

Eigen::Vector3d RignetFrame::to_anymate(const Eigen::Vector3d& point) const {
  return 2.0 * point + Eigen::Vector3d(0.0, floor_, 0.0);
}

Eigen::Vector3d RignetFrame::into(const Eigen::Vector3d& point) const { return from_anymate(anymate_.into(point)); }
Eigen::Vector3d RignetFrame::out_of(const Eigen::Vector3d& point) const { return anymate_.out_of(to_anymate(point)); }

RignetMesh rignet_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       std::size_t most_vertices) {
  RignetMesh mesh;
  mesh.frame = RignetFrame::of(vertices);
  const Surface surface = coarsened(welded(vertices, faces), bounding_box(vertices).longest_side(), most_vertices);
  for (const Eigen::Vector3f& vertex : surface.vertices)
    mesh.vertices.emplace_back(mesh.frame.into(vertex.cast<double>()).cast<float>());
  mesh.faces = surface.faces;
  return mesh;
}

SolidShape::SolidShape(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
    : frame_(RignetFrame::of(vertices)) {
  Mesh mesh;
  mesh.vertices = vertices;
  mesh.faces = faces;
  const rigging::WeldedSurface surface = rigging::weld_surface(mesh);
  if (!surface.has_extent) throw InputError("", "faces", "the mesh has no extent");
  const rigging::SolidVoxels solid = rigging::solid_voxels(surface, {}, kSolidResolution, /*validate=*/false);
  center_ = surface.center;
  size_ = surface.size;
  block_ = solid.block;
  for (std::size_t cell = 0; cell < block_.cells(); ++cell) is_solid_.push_back(solid.is_solid(cell));
}

bool SolidShape::holds(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d place = block_.measured((frame_.out_of(point) - center_) / size_).array().floor();
  for (int axis = 0; axis < 3; ++axis) {
    if (!(place[axis] >= 0.0 && place[axis] < block_.size[static_cast<std::size_t>(axis)])) return false;
  }
  return is_solid_[block_.index(static_cast<int>(place.x()), static_cast<int>(place.y()), static_cast<int>(place.z()))];
}

torch::Tensor SolidShape::holds(const torch::Tensor& points) const {
  torch::Tensor inside = torch::empty({points.size(0)}, torch::kBool);
  bool* out = inside.data_ptr<bool>();
  for (const Eigen::Vector3d& point : nn::points_of<double>(points, "points")) *out++ = holds(point);
  return inside;
}

SolidShape::Way SolidShape::way(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / kWayStep)));
  Way found;
  for (int i = 0; i <= steps; ++i)
    found.outside += holds(Eigen::Vector3d(from + (to - from) * (static_cast<double>(i) / steps))) ? 0 : 1;
  found.inside = 1.0 - static_cast<double>(found.outside) / (steps + 1);
  return found;
}

SolidShape::Ways SolidShape::ways(const std::vector<Eigen::Vector3d>& joints) const {
  const auto count = static_cast<std::int64_t>(joints.size());
  Ways all{torch::empty({count, count}), torch::empty({count, count})};
  auto inside = all.inside.accessor<float, 2>(), outside = all.outside.accessor<float, 2>();
  for (std::int64_t i = 0; i < count; ++i) {
    for (std::int64_t j = i; j < count; ++j) {
      const Way one = way(joints[static_cast<std::size_t>(i)], joints[static_cast<std::size_t>(j)]);
      inside[i][j] = inside[j][i] = static_cast<float>(one.inside);
      outside[i][j] = outside[j][i] = static_cast<float>(one.outside);
    }
  }
  return all;
}

SurfacePaths::SurfacePaths(const RignetMesh& mesh, std::size_t samples, std::uint64_t seed)
    : vertices_(mesh.vertices.size()) {
  Cloud cloud{mesh.vertices, vertex_normals(mesh.vertices, mesh.faces)};
  add_samples(mesh, samples, seed, cloud);
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  const MeshEdges edges(mesh.faces, vertices_);
  for (const MeshEdges::Edge& edge : edges.all()) pairs.emplace_back(edge[0], edge[1]);
  add_nearest(cloud, pairs);
  points_ = std::move(cloud.points);
  join(pairs);
}

void SurfacePaths::join(const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs) {
  std::vector<std::pair<std::int32_t, std::int32_t>> both = pairs;
  for (const auto& [a, b] : pairs) both.emplace_back(b, a);
  std::sort(both.begin(), both.end());
  both.erase(std::unique(both.begin(), both.end()), both.end());
  first_link_.assign(points_.size() + 1, 0);
  for (const auto& [a, b] : both) {
    links_.push_back({b, (points_[at(a)] - points_[at(b)]).norm()});
    first_link_[at(a) + 1] = links_.size();
  }
  for (std::size_t i = 1; i < first_link_.size(); ++i) first_link_[i] = std::max(first_link_[i], first_link_[i - 1]);
}

template <typename Reach>
std::vector<SurfacePaths::Nearest> SurfacePaths::spread(const std::vector<std::int32_t>& sources, double radius,
                                                        const Reach& reach) const {
  std::vector<Nearest> found(points_.size(), Nearest{-1, std::numeric_limits<double>::infinity()});
  Queue open;
  for (const std::int32_t vertex : sources) {
    found[at(vertex)] = {vertex, 0.0};
    open.push({0.0, vertex});
  }
  while (!open.empty()) {
    const auto [here, point] = open.top();
    open.pop();
    if (here > found[at(point)].distance) continue;
    reach(point, here);
    for (std::size_t l = first_link_[at(point)]; l < first_link_[at(point) + 1]; ++l) {
      const double there = here + links_[l].length;
      if (there >= radius || there >= found[at(links_[l].to)].distance) continue;
      found[at(links_[l].to)] = {found[at(point)].source, there};
      open.push({there, links_[l].to});
    }
  }
  return found;
}

std::vector<SurfacePaths::Reached> SurfacePaths::within(std::int32_t vertex, double radius) const {
  std::vector<Reached> found;
  spread({vertex}, radius, [&, vertex](std::int32_t point, double distance) {
    if (at(point) < vertices_ && point != vertex) found.push_back({point, distance});
  });
  return found;
}

std::vector<SurfacePaths::Nearest> SurfacePaths::from(const std::vector<std::int32_t>& sources) const {
  std::vector<Nearest> nearest = spread(sources, std::numeric_limits<double>::infinity(), [](std::int32_t, double) {});
  nearest.resize(vertices_);
  for (Nearest& vertex : nearest) {
    if (vertex.source < 0) vertex.distance = 0.0;
  }
  return nearest;
}

}  // namespace anigen::rignet
