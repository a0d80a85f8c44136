#include "anigen/rig/embedding/embed_skeleton.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/rig/embedding/bone_refinement.h"
#include "anigen/rig/embedding/carried_joints.h"
#include "anigen/rig/embedding/discrete_embedding.h"
#include "anigen/rig/embedding/medial_spheres.h"
#include "anigen/rig/embedding/solid_field.h"
#include "anigen/rig/embedding/sphere_graph.h"

namespace anigen::rig {
namespace {

using Points3 = std::vector<Eigen::Vector3d>;

std::vector<Sphere> spheres_or_deepest(const SolidField& field, const std::vector<Sphere>& samples,
                                       const EmbeddingOptions& options) {
  std::vector<Sphere> spheres = packed_spheres(samples, options.most_spheres);
  if (!spheres.empty()) return spheres;
  // A solid so small in its box that no point is deep enough: its deepest cell.
  std::size_t deepest = 0;
  for (std::size_t cell = 1; cell < field.distance.size(); ++cell) {
    if (field.distance[cell] < field.distance[deepest]) deepest = cell;
  }
  const auto c = field.grid.cell(deepest);
  const double depth = std::max(-static_cast<double>(field.distance[deepest]), 1e-3 * field.grid.spacing);
  return {{field.grid.center(c[0], c[1], c[2]), depth}};
}

/// The joints of the template along the ways between the vertices of the reduced one (stage 8).
Points3 unreduced(const TemplateSkeleton& skeleton, const ReducedSkeleton& reduced, const SphereGraph& graph,
                  const std::vector<int>& vertices) {
  Points3 joints(skeleton.joints.size(), Eigen::Vector3d::Zero());
  for (std::size_t k = 0; k < reduced.joints.size(); ++k) {
    const ReducedJoint& joint = reduced.joints[k];
    joints[at(joint.joint)] = graph[vertices[k]].center;
    if (joint.parent < 0) continue;
    const int u = vertices[at(joint.parent)];
    std::vector<int> way;
    for (int w = vertices[k]; w >= 0; w = graph.before(u, w)) way.insert(way.begin(), w);
    std::size_t step = 1;
    for (std::size_t c = 0; c + 1 < joint.chain.size(); ++c) {
      Eigen::Vector3d& place = joints[at(joint.chain[c])];
      if (way.size() < 2) {
        place = graph[u].center;
        continue;
      }
      const double along = joint.fractions[c] * graph.distance(u, vertices[k]);
      while (step + 1 < way.size() && graph.distance(u, way[step]) < along) ++step;
      const double from = graph.distance(u, way[step - 1]), to = graph.distance(u, way[step]);
      const double t = to > from ? (along - from) / (to - from) : 0.0;
      place = (1.0 - t) * graph[way[step - 1]].center + t * graph[way[step]].center;
    }
  }
  return joints;
}

Skeleton without_guides(const TemplateSkeleton& skeleton, const Points3& joints, bool keep_guides) {
  Points3 positions;
  std::vector<int> parents, number(joints.size(), -1);
  std::vector<std::string> names;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const TemplateJoint& joint = skeleton.joints[j];
    if (joint.guide && !keep_guides) continue;
    number[j] = static_cast<int>(positions.size());
    positions.push_back(joints[j]);
    parents.push_back(joint.parent < 0 ? -1 : number[at(joint.parent)]);
    names.push_back(joint.name);
  }
  return skeleton_from_joints(positions, parents, names);
}

}  // namespace

struct EmbeddingSpace::Implementation {
  Implementation(const Mesh& mesh, const EmbeddingOptions& given)
      : options(given),
        field(solid_field(mesh, given.size, given.resolution)),
        samples(medial_samples(field, 2.0 * given.tolerance)),
        graph(field, spheres_or_deepest(field, samples, given)) {
    if (samples.empty()) samples.push_back(graph[0]);
    medial_distance = distance_to_medial(field, samples);
  }

  /// How much longer the mesh's box is than the template's, along each axis, when their longest sides are the same.
  Eigen::Vector3d stretch(const TemplateSkeleton& skeleton) const {
    const Eigen::Vector3d mesh_sides = field.mesh_sides / field.mesh_sides.maxCoeff();
    const Eigen::Vector3d sides = skeleton.box / skeleton.box.maxCoeff();
    Eigen::Vector3d factors;
    for (int axis = 0; axis < 3; ++axis) {
      const double ratio = mesh_sides[axis] / std::max(sides[axis], 1e-6);
      factors[axis] = std::clamp(ratio, 1.0 / options.most_stretch, options.most_stretch);
    }
    return factors;
  }

  EmbeddingOptions options;
  SolidField field;
  std::vector<Sphere> samples;
  SphereGraph graph;
  std::vector<float> medial_distance;
};

EmbeddingSpace::EmbeddingSpace(const Mesh& mesh, const EmbeddingOptions& options) {
  check(options);
  implementation_ = std::make_unique<Implementation>(mesh, options);
}

EmbeddingSpace::~EmbeddingSpace() = default;
EmbeddingSpace::EmbeddingSpace(EmbeddingSpace&&) noexcept = default;

EmbeddedSkeleton EmbeddingSpace::embed(const TemplateSkeleton& skeleton) const {
  const Implementation& space = *implementation_;
  EmbeddedSkeleton result;
  TemplateSkeleton used;
  ReducedSkeleton reduced;
  DiscreteEmbedding found;
  for (const bool stretched : {false, true}) {
    const Eigen::Vector3d factors = stretched ? space.stretch(skeleton) : Eigen::Vector3d::Ones();
    if (stretched && factors == Eigen::Vector3d::Ones()) continue;
    TemplateSkeleton tried = skeleton;
    for (TemplateJoint& joint : tried.joints) joint.position = joint.position.cwiseProduct(factors);
    ReducedSkeleton tried_reduced = reduced_skeleton(tried, space.options.size);
    DiscreteEmbedding embedding = discrete_embedding(space.graph, tried_reduced, space.options);
    result.states += embedding.states;
    embedding.penalty += space.options.stretch_weight * factors.array().log().square().sum();
    if (stretched && !(embedding.penalty < found.penalty)) continue;
    result.stretched = stretched;
    used = std::move(tried);
    reduced = std::move(tried_reduced);
    found = std::move(embedding);
  }
  for (TemplateJoint& joint : used.joints) joint.position *= space.options.size;

  result.penalty = found.penalty;
  result.best = found.best;
  result.spheres = space.graph.size();
  result.bridges = space.graph.bridges();
  Points3 joints = unreduced(used, reduced, space.graph, found.vertices);
  const BoneRefinement refinement(space.field, space.medial_distance, used, space.options);
  result.energy_before = refinement.energy(joints);
  refinement.refine(joints);
  result.energy = refinement.energy(joints);
  place_carried_joints(used, joints);
  const Similarity& from_mesh = space.field.from_mesh;
  for (Eigen::Vector3d& joint : joints) joint = (joint - from_mesh.offset) / from_mesh.scale;
  result.skeleton = without_guides(skeleton, joints, space.options.keep_guides);
  return result;
}

EmbeddedSkeleton embed_skeleton(const Mesh& mesh, const TemplateSkeleton& skeleton, const EmbeddingOptions& options) {
  check(skeleton);
  return EmbeddingSpace(mesh, options).embed(skeleton);
}

TemplateChoice choose_template(const Mesh& mesh, const std::vector<TemplateSkeleton>& templates,
                               const EmbeddingOptions& options) {
  if (templates.empty()) throw InputError("", "templates", "there is none to choose from");
  for (const TemplateSkeleton& skeleton : templates) check(skeleton);
  const EmbeddingSpace space(mesh, options);
  TemplateChoice choice;
  for (std::size_t i = 0; i < templates.size(); ++i) {
    EmbeddedSkeleton embedded = space.embed(templates[i]);
    choice.penalties.push_back(embedded.penalty);
    if (i > 0 && !(embedded.penalty < choice.embedded.penalty)) continue;
    choice.index = i;
    choice.embedded = std::move(embedded);
  }
  return choice;
}

}  // namespace anigen::rig
