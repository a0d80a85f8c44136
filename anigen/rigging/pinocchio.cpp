#include "anigen/rigging/pinocchio.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/rigging/pinocchio_solid.h"
#include "anigen/rigging/pinocchio_spheres.h"

namespace anigen::rigging {

namespace {

constexpr int kBoneSamples = 10;
constexpr double kDifference = 1e-4;  // for gradients
constexpr double kFirstStep = 0.0005;
constexpr int kMostDoublings = 30;

/// Stage 9: moves the joints of an embedding where bones run in the middle of the solid, without becoming shorter than
/// or turning away from those of the template, or longer than those of the other side: the least sum over bones of
/// surface_weight · E_surf + bone_length_weight · E_len + bone_angle_weight · E_angle + bone_symmetry_weight · E_sym,
/// by gradient descent with line searches.
class BoneRefinement {
 public:
  /// @param medial_distance as distance_to_medial() @param skeleton with positions in the frame of the field
  BoneRefinement(const SolidField& field, const std::vector<float>& medial_distance, const TemplateSkeleton& skeleton,
                 const EmbeddingOptions& options)
      : field_(field), medial_distance_(medial_distance), skeleton_(skeleton), options_(options) {
    const auto& joints = skeleton.joints;
    bones_of_.resize(joints.size());
    for (std::size_t j = 1; j < joints.size(); ++j) {
      const auto parent = at(joints[j].parent);
      if (joints[j].carried || joints[parent].carried) continue;
      bones_.push_back(j);
      bones_of_[j].push_back(j);
      bones_of_[parent].push_back(j);
      if (joints[j].mirror < 1) continue;
      // A bone is compared with that of the other side, so its energy depends on those joints too.
      const auto other = at(joints[j].mirror);
      bones_of_[other].push_back(j);
      bones_of_[at(joints[other].parent)].push_back(j);
    }
    for (auto& list : bones_of_) {
      std::sort(list.begin(), list.end());
      list.erase(std::unique(list.begin(), list.end()), list.end());
    }
  }

  /// @param joints [J]; those that are carried neither move nor count
  void refine(std::vector<Eigen::Vector3d>& joints) const {
    std::vector<std::size_t> all;
    for (std::size_t j = 0; j < joints.size(); ++j) {
      if (!bones_of_[j].empty()) all.push_back(j);
    }
    for (int round = 0; round < options_.refinement_rounds; ++round) {
      for (int i = 0; i < 2; ++i) search_along_gradient(joints, all);
      for (const std::size_t bone : bones_) search_along_gradient(joints, {at(skeleton_.joints[bone].parent), bone});
    }
  }

  double energy(const std::vector<Eigen::Vector3d>& joints) const { return energy_around(joints, bones_); }

 private:
  /// E_surf: the mean over 10 samples of min(distance to the medial surface, 0.001 + max(0, 0.05 − depth))², counted
  /// only above tolerance².
  double depth_energy(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
    double sum = 0.0;
    for (int i = 0; i < kBoneSamples; ++i) {
      const double t = (i + 0.5) / kBoneSamples;
      const Eigen::Vector3d p = (1.0 - t) * from + t * to;
      const double medial = interpolate(field_.grid, medial_distance_, p);
      const double shallow = 0.001 + std::max(0.0, 0.05 + field_.value(p));
      const double squared = std::min(medial, shallow) * std::min(medial, shallow);
      if (squared > options_.tolerance * options_.tolerance) sum += squared;
    }
    return sum / kBoneSamples;
  }

  double bone_energy(std::size_t bone, const std::vector<Eigen::Vector3d>& joints) const {
    const TemplateJoint& joint = skeleton_.joints[bone];
    const auto parent = at(joint.parent);
    const Eigen::Vector3d way = joints[bone] - joints[parent];
    const Eigen::Vector3d wanted = joint.position - skeleton_.joints[parent].position;
    double sum = options_.surface_weight * depth_energy(joints[parent], joints[bone]);
    const double wanted_length = wanted.norm(), length = way.norm();
    if (wanted_length > 0.0) {
      // E_len = max(½, (ε + L²) / (ε + ℓ²)) with ℓ the way along the template's bone, E_angle = (0.3 + ½ acos dot)³.
      const double along = way.dot(wanted) / wanted_length;
      sum +=
          options_.bone_length_weight * std::max(0.5, (1e-4 + wanted_length * wanted_length) / (1e-4 + along * along));
      const double dot = length > 1e-12 ? std::clamp(along / length, -1.0, 1.0) : 1.0;
      const double angle = 0.3 + 0.5 * std::acos(dot);
      sum += options_.bone_angle_weight * (dot < 0.0 ? 10.0 : 1.0) * angle * angle * angle;
    }
    const int mirror = joint.mirror;
    if (mirror >= 1 && !skeleton_.joints[at(mirror)].carried) {
      // E_sym: the ratio of the squared lengths of both sides, whichever way it is larger.
      const double other = (joints[at(mirror)] - joints[at(skeleton_.joints[at(mirror)].parent)]).squaredNorm();
      const double a = 1e-3 + length * length, b = 1e-3 + other;
      sum += options_.bone_symmetry_weight * std::max(1.05, std::max(a / b, b / a));
    }
    return sum;
  }

  double energy_around(const std::vector<Eigen::Vector3d>& joints, const std::vector<std::size_t>& bones) const {
    double sum = 0.0;
    for (const std::size_t bone : bones) sum += bone_energy(bone, joints);
    return sum;
  }

  std::vector<std::size_t> bones_at(const std::vector<std::size_t>& moving) const {
    std::vector<std::size_t> bones;
    for (const std::size_t j : moving) bones.insert(bones.end(), bones_of_[j].begin(), bones_of_[j].end());
    std::sort(bones.begin(), bones.end());
    bones.erase(std::unique(bones.begin(), bones.end()), bones.end());
    return bones;
  }

  /// Central differences for some joints, 0 for others.
  std::vector<Eigen::Vector3d> gradient(const std::vector<Eigen::Vector3d>& joints,
                                        const std::vector<std::size_t>& moving) const {
    std::vector<Eigen::Vector3d> result(joints.size(), Eigen::Vector3d::Zero());
    std::vector<Eigen::Vector3d> moved = joints;
    for (const std::size_t j : moving) {
      for (int axis = 0; axis < 3; ++axis) {
        moved[j][axis] = joints[j][axis] + kDifference;
        const double above = energy_around(moved, bones_of_[j]);
        moved[j][axis] = joints[j][axis] - kDifference;
        const double below = energy_around(moved, bones_of_[j]);
        moved[j][axis] = joints[j][axis];
        result[j][axis] = (above - below) / (2.0 * kDifference);
      }
    }
    return result;
  }

  /// Steps along −g from 0.0005 / √(0.001 + |g|²), doubled while the energy falls.
  void search_along_gradient(std::vector<Eigen::Vector3d>& joints, const std::vector<std::size_t>& moving) const {
    const std::vector<Eigen::Vector3d> slope = gradient(joints, moving);
    double squared = 0.0;
    for (const std::size_t j : moving) squared += slope[j].squaredNorm();
    const std::vector<std::size_t> bones = bones_at(moving);
    double step = kFirstStep / std::sqrt(0.001 + squared), best = energy_around(joints, bones), best_step = 0.0;
    std::vector<Eigen::Vector3d> tried = joints;
    for (int i = 0; i < kMostDoublings; ++i, step *= 2.0) {
      for (const std::size_t j : moving) tried[j] = joints[j] - step * slope[j];
      const double here = energy_around(tried, bones);
      if (!(here < best)) break;
      best = here;
      best_step = step;
    }
    for (const std::size_t j : moving) joints[j] -= best_step * slope[j];
  }

  const SolidField& field_;
  const std::vector<float>& medial_distance_;
  const TemplateSkeleton& skeleton_;
  const EmbeddingOptions& options_;
  std::vector<std::size_t> bones_;                  ///< joints whose bone to the parent counts
  std::vector<std::vector<std::size_t>> bones_of_;  ///< [J], bones whose energy a joint has a part in
};

constexpr double kLeastScale = 0.25, kMostScale = 4.0;

/// Similarity that takes the template's bone into the embedded one.
Eigen::Matrix3d bone_change(const Eigen::Vector3d& wanted, const Eigen::Vector3d& embedded) {
  if (!(wanted.norm() > 1e-9) || !(embedded.norm() > 1e-9)) return Eigen::Matrix3d::Identity();
  const double scale = std::clamp(embedded.norm() / wanted.norm(), kLeastScale, kMostScale);
  return scale * Eigen::Quaterniond::FromTwoVectors(wanted, embedded).toRotationMatrix();
}

/// Places the carried joints of a template with those they hang on: turned and scaled like the bone that leads there
/// from its parent, where there is one, else moved only. Joints above the first that is not carried move with it.
/// @param skeleton positions in the frame of the joints @param joints [J], those that are not carried in place
void place_carried_joints(const TemplateSkeleton& skeleton, std::vector<Eigen::Vector3d>& joints) {
  const auto& wanted = skeleton.joints;
  const auto first = static_cast<std::size_t>(
      std::find_if(wanted.begin(), wanted.end(), [](const TemplateJoint& joint) { return !joint.carried; }) -
      wanted.begin());
  // Subtrees of carried joints share the change of the joint they hang on.
  std::vector<Eigen::Matrix3d> change(wanted.size(), Eigen::Matrix3d::Identity());
  std::vector<char> above(wanted.size(), 0);
  for (int j = wanted[first].parent; j >= 0; j = wanted[at(j)].parent) {
    above[at(j)] = 1;
    joints[at(j)] = joints[first] + wanted[at(j)].position - wanted[first].position;
  }
  for (std::size_t j = 1; j < wanted.size(); ++j) {
    if (above[j] != 0 || j == first) continue;
    const auto parent = at(wanted[j].parent);
    const Eigen::Vector3d bone = wanted[j].position - wanted[parent].position;
    if (wanted[j].carried) {
      change[j] = change[parent];
      joints[j] = joints[parent] + change[parent] * bone;
    } else {
      change[j] = bone_change(bone, joints[j] - joints[parent]);
    }
  }
}

using Points3 = std::vector<Eigen::Vector3d>;

std::vector<Sphere> spheres_or_deepest(const SolidField& field, const std::vector<Sphere>& samples,
                                       const EmbeddingOptions& options) {
  std::vector<Sphere> spheres = packed_spheres(samples, options.most_spheres);
  if (!spheres.empty()) return spheres;
  // A solid so small in its box that no point is deep enough: its deepest cell.
  const auto deepest = std::min_element(field.distance.begin(), field.distance.end());
  const double depth = std::max(-static_cast<double>(*deepest), 1e-3 * field.grid.spacing);
  return {{field.grid.center(static_cast<std::size_t>(deepest - field.distance.begin())), depth}};
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

/// A mesh made ready for templates: its distance field, its medial spheres and the ways between them.
class EmbeddingSpace {
 public:
  EmbeddingSpace(const Mesh& mesh, const EmbeddingOptions& options)
      : options_(options),
        field_(solid_field(mesh, options.size, options.resolution)),
        samples_(medial_samples(field_, 2.0 * options.tolerance)),
        graph_(field_, spheres_or_deepest(field_, samples_, options)) {
    if (samples_.empty()) samples_.push_back(graph_[0]);
    medial_distance_ = distance_to_medial(field_, samples_);
  }

  /// @param least penalty of all templates yet, to which this one's is added; beyond it a template is given up, and has
  /// an infinite penalty and no skeleton
  EmbeddedSkeleton embed(const TemplateSkeleton& skeleton, std::atomic<double>& least) const {
    EmbeddedSkeleton result;
    TemplateSkeleton used;
    ReducedSkeleton reduced;
    DiscreteEmbedding found;
    for (const bool stretched : {false, true}) {
      const Eigen::Vector3d factors = stretched ? stretch(skeleton) : Eigen::Vector3d::Ones();
      if (stretched && factors == Eigen::Vector3d::Ones()) continue;
      TemplateSkeleton tried = skeleton;
      for (TemplateJoint& joint : tried.joints) joint.position = joint.position.cwiseProduct(factors);
      ReducedSkeleton tried_reduced = reduced_skeleton(tried, options_.size);
      const double surcharge = options_.stretch_weight * factors.array().log().square().sum();
      DiscreteEmbedding embedding = discrete_embedding(graph_, tried_reduced, options_, &least, surcharge);
      result.states += embedding.states;
      embedding.penalty += surcharge;
      if (embedding.given_up || (!found.vertices.empty() && !(embedding.penalty < found.penalty))) continue;
      for (double known = least; embedding.penalty < known;) {
        if (least.compare_exchange_weak(known, embedding.penalty)) break;
      }
      result.stretched = stretched;
      used = std::move(tried);
      reduced = std::move(tried_reduced);
      found = std::move(embedding);
    }
    if (found.vertices.empty()) {
      result.penalty = std::numeric_limits<double>::infinity();
      return result;
    }
    for (TemplateJoint& joint : used.joints) joint.position *= options_.size;

    result.penalty = found.penalty;
    result.best = found.best;
    result.spheres = graph_.size();
    result.bridges = graph_.bridges();
    Points3 joints = unreduced(used, reduced, graph_, found.vertices);
    const BoneRefinement refinement(field_, medial_distance_, used, options_);
    result.energy_before = refinement.energy(joints);
    refinement.refine(joints);
    result.energy = refinement.energy(joints);
    place_carried_joints(used, joints);
    const Similarity& from_mesh = field_.from_mesh;
    for (Eigen::Vector3d& joint : joints) joint = (joint - from_mesh.offset) / from_mesh.scale;
    result.skeleton = without_guides(skeleton, joints, options_.keep_guides);
    return result;
  }

 private:
  /// Ratio of the mesh's box to the template's, along each axis, when their longest sides are the same.
  Eigen::Vector3d stretch(const TemplateSkeleton& skeleton) const {
    const Eigen::Vector3d mesh_sides = field_.mesh_sides / field_.mesh_sides.maxCoeff();
    const Eigen::Vector3d sides = skeleton.box / skeleton.box.maxCoeff();
    Eigen::Vector3d factors;
    for (int axis = 0; axis < 3; ++axis) {
      const double ratio = mesh_sides[axis] / std::max(sides[axis], 1e-6);
      factors[axis] = std::clamp(ratio, 1.0 / options_.most_stretch, options_.most_stretch);
    }
    return factors;
  }

  const EmbeddingOptions& options_;
  SolidField field_;
  std::vector<Sphere> samples_;
  SphereGraph graph_;
  std::vector<float> medial_distance_;
};

}  // namespace

EmbeddedSkeleton embed_skeleton(const Mesh& mesh, const TemplateSkeleton& skeleton, const EmbeddingOptions& options) {
  return choose_template(mesh, {skeleton}, options).embedded;
}

TemplateChoice choose_template(const Mesh& mesh, const std::vector<TemplateSkeleton>& templates,
                               const EmbeddingOptions& options) {
  if (templates.empty()) throw InputError("", "templates", "there is none to choose from");
  for (const TemplateSkeleton& skeleton : templates) check(skeleton);
  check(options);
  const EmbeddingSpace space(mesh, options);
  std::vector<EmbeddedSkeleton> embedded(templates.size());
  std::atomic<double> least = std::numeric_limits<double>::infinity();
  parallel_for(templates.size(), [&](std::size_t i) { embedded[i] = space.embed(templates[i], least); });
  TemplateChoice choice;
  for (std::size_t i = 0; i < templates.size(); ++i) {
    choice.penalties.push_back(embedded[i].penalty);
    if (i > 0 && !(embedded[i].penalty < choice.embedded.penalty)) continue;
    choice.index = i;
    choice.embedded = std::move(embedded[i]);
  }
  return choice;
}

}  // namespace anigen::rigging
