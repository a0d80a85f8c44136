#include "anigen/asset/rigid_parts.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/asset/mesh_shells.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen {

namespace {

/// A third of the area of the faces at every vertex.
std::vector<double> vertex_areas(const Mesh& mesh) {
  std::vector<double> areas(mesh.vertices.size(), 0.0);
  for (const Triangle& face : mesh.faces) {
    const double area = 0.5 * area_vector(mesh.vertices, face).norm();
    if (!std::isfinite(area)) continue;
    for (const std::int32_t corner : face) areas[at(corner)] += area / 3.0;
  }
  return areas;
}

}  // namespace

std::string RigidSkin::note() const {
  std::size_t rigid = 0;
  double area = 0.0;
  for (const RigidPart& part : parts) {
    if (!part.rigid) continue;
    ++rigid;
    area += part.area;
  }
  return std::to_string(rigid) + " of " + std::to_string(parts.size()) + (parts.size() == 1 ? " shell" : " shells") +
         " rigid, " + std::to_string(std::lround(100.0 * area)) + " % of the surface";
}

Json RigidSkin::to_json(const Skeleton& skeleton) const {
  Json list = Json::array();
  for (const RigidPart& part : parts) {
    list.push_back({{"joint", skeleton.names.at(at(part.joint))},
                    {"share", part.share},
                    {"vertices", part.vertices},
                    {"area", part.area},
                    {"rigid", part.rigid}});
  }
  return list;
}

RigidSkin rigid_parts(const Mesh& mesh, const SkinWeights& skin, double least_share) {
  if (!(least_share > 0.5 && least_share <= 1.0))
    throw InputError("", "rigid share", "must lie above 0.5 and not above 1");
  if (skin.rows() != mesh.vertices.size()) {
    throw InputError(
        "", "rigid parts",
        std::to_string(skin.rows()) + " rows of weights for " + std::to_string(mesh.vertices.size()) + " vertices");
  }
  const MeshShells shells = mesh_shells(mesh.vertices, mesh.faces);
  const std::vector<double> areas = vertex_areas(mesh);
  RigidSkin result;
  result.parts.resize(shells.count);
  double whole = 0.0;
  for (std::size_t v = 0; v < areas.size(); ++v) {
    if (shells.of_vertex[v] < 0) continue;
    RigidPart& part = result.parts[at(shells.of_vertex[v])];
    ++part.vertices;
    part.area += areas[v];
    whole += areas[v];
  }
  std::vector<std::map<std::int32_t, double>> weights(shells.count);
  for (std::size_t v = 0; v < areas.size(); ++v) {
    if (shells.of_vertex[v] < 0) continue;
    const std::size_t shell = at(shells.of_vertex[v]);
    const double counts = result.parts[shell].area > 0.0 ? areas[v] : 1.0;
    for (std::size_t i = 0; i < skin.row_size(v); ++i)
      weights[shell][skin.row(v)[i].joint] += counts * static_cast<double>(skin.row(v)[i].weight);
  }
  for (std::size_t shell = 0; shell < shells.count; ++shell) {
    RigidPart& part = result.parts[shell];
    if (whole > 0.0) part.area /= whole;
    double sum = 0.0, most = 0.0;
    for (const auto& [joint, weight] : weights[shell]) {
      sum += weight;
      if (weight <= most) continue;
      most = weight;
      part.joint = joint;
    }
    if (!(sum > 0.0)) continue;
    part.share = std::min(1.0, most / sum);
    part.rigid = part.share >= least_share;
  }
  for (std::size_t v = 0; v < areas.size(); ++v) {
    const std::int32_t shell = shells.of_vertex[v];
    if (shell >= 0 && result.parts[at(shell)].rigid)
      result.skin.append_row({{result.parts[at(shell)].joint, 1.0F}});
    else
      result.skin.append_copy(skin, v);
  }
  return result;
}

}  // namespace anigen
