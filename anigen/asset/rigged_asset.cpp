#include "anigen/asset/rigged_asset.h"

#include <Eigen/LU>
#include <cmath>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen {

void bind_rigidly(Asset& asset, const std::string& joint) {
  const std::vector<Eigen::Vector3d> origin(1, Eigen::Vector3d::Zero());
  asset.skeleton = skeleton_from_joints(origin, {-1}, std::vector<std::string>(1, joint));
  asset.skin = SkinWeights();
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) asset.skin.append_row({Influence{0, 1.0F}});
}

namespace {

// Collects findings by kind, so that a mesh of a million NaNs gives three lines and a count.
class Findings {
 public:
  explicit Findings(std::size_t at_most) : at_most_(at_most) {}

  void add(const std::string& kind, const std::string& sentence) {
    if (counts_[kind]++ < at_most_) sentences_.push_back(sentence);
  }
  std::vector<std::string> take() {
    for (const auto& [kind, count] : counts_) {
      if (count > at_most_) sentences_.push_back(kind + ": " + std::to_string(count - at_most_) + " more");
    }
    return std::move(sentences_);
  }

 private:
  std::size_t at_most_;
  std::map<std::string, std::size_t> counts_;
  std::vector<std::string> sentences_;
};

std::string element(const char* array, std::size_t index) {
  return std::string(array) + "[" + std::to_string(index) + "]";
}

void check_length(Findings& findings, const char* array, std::size_t length, std::size_t expected, bool may_be_empty) {
  if (length == expected || (may_be_empty && length == 0)) return;
  findings.add("array lengths", std::string(array) + " has " + std::to_string(length) + " entries, expected " +
                                    std::to_string(expected));
}

bool finite(const Transform& t) {
  return t.translation.allFinite() && t.rotation.coeffs().allFinite() && t.scale.allFinite();
}

void check_mesh(Findings& findings, const Asset& asset, bool require_faces) {
  const Mesh& mesh = asset.mesh;
  if (mesh.vertices.empty()) findings.add("mesh", "mesh has no vertices");
  if (mesh.faces.empty() && require_faces) findings.add("mesh", "mesh has no faces");
  const std::size_t count = mesh.vertices.size();
  check_length(findings, "normals", mesh.normals.size(), count, true);
  check_length(findings, "uvs", mesh.uvs.size(), count, true);
  check_length(findings, "colors", mesh.colors.size(), count, true);
  check_length(findings, "face_materials", mesh.face_materials.size(), mesh.faces.size(), true);
  for (std::size_t v = 0; v < count; ++v) {
    if (!mesh.vertices[v].allFinite()) findings.add("vertices not finite", element("vertices", v) + " is not finite");
  }
  for (std::size_t v = 0; v < mesh.normals.size(); ++v) {
    if (!mesh.normals[v].allFinite())
      findings.add("normals not finite", element("normals", v) + " is not finite");
    else if (std::abs(mesh.normals[v].norm() - 1.0f) > 1e-3f)
      findings.add("normals not unit", element("normals", v) + " is not of unit length");
  }
  for (std::size_t v = 0; v < mesh.uvs.size(); ++v) {
    if (!mesh.uvs[v].allFinite()) findings.add("uvs not finite", element("uvs", v) + " is not finite");
  }
  for (std::size_t v = 0; v < mesh.colors.size(); ++v) {
    if (!mesh.colors[v].allFinite()) findings.add("colors not finite", element("colors", v) + " is not finite");
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t corner : mesh.faces[f]) {
      if (corner < 0 || static_cast<std::size_t>(corner) >= count) {
        findings.add("face indices", element("faces", f) + " refers to vertex " + std::to_string(corner) + " of " +
                                         std::to_string(count));
      }
    }
  }
  for (std::size_t f = 0; f < mesh.face_materials.size(); ++f) {
    const int material = mesh.face_materials[f];
    if (material < -1 || material >= static_cast<int>(asset.materials.size()))
      findings.add("face materials", element("face_materials", f) + " refers to material " + std::to_string(material));
  }
  for (std::size_t m = 0; m < asset.materials.size(); ++m) {
    const Material& material = asset.materials[m];
    if (material.image < -1 || material.image >= static_cast<int>(asset.images.size()))
      findings.add("material images", element("materials", m) + " refers to image " + std::to_string(material.image));
    if (!material.base_color.allFinite())
      findings.add("material colours", element("materials", m) + " has a colour that is not finite");
  }
}

void check_skeleton(Findings& findings, const Skeleton& skeleton) {
  const std::size_t count = skeleton.parents.size();
  if (count == 0) {
    findings.add("skeleton", "skeleton has no joints");
    return;
  }
  check_length(findings, "names", skeleton.names.size(), count, false);
  check_length(findings, "bind", skeleton.bind.size(), count, false);
  check_length(findings, "rest", skeleton.rest.size(), count, false);
  if (skeleton.parents[0] != -1)
    findings.add("tree", "parents[0] is " + std::to_string(skeleton.parents[0]) + ": joint 0 must be the root (-1)");
  for (std::size_t j = 1; j < count; ++j) {
    const int parent = skeleton.parents[j];
    if (parent < 0 || static_cast<std::size_t>(parent) >= j) {
      findings.add("tree", element("parents", j) + " is " + std::to_string(parent) +
                               ": parents come before their children, and only joint 0 is a root");
    }
  }
  std::set<std::string> names;
  for (std::size_t j = 0; j < skeleton.names.size(); ++j) {
    if (skeleton.names[j].empty())
      findings.add("names", element("names", j) + " is empty");
    else if (!names.insert(skeleton.names[j]).second)
      findings.add("names", element("names", j) + " repeats '" + skeleton.names[j] + "'");
  }
  for (std::size_t j = 0; j < skeleton.bind.size(); ++j) {
    const Eigen::Matrix4d& bind = skeleton.bind[j];
    if (!bind.allFinite())
      findings.add("bind matrices", element("bind", j) + " is not finite");
    else if (bind.row(3) != Eigen::RowVector4d(0, 0, 0, 1))
      findings.add("bind matrices", element("bind", j) + " is not affine");
    else if (!Eigen::Matrix4d(bind.inverse()).allFinite() || bind.topLeftCorner<3, 3>().determinant() == 0.0)
      findings.add("bind matrices", element("bind", j) + " cannot be inverted");
  }
  for (std::size_t j = 0; j < skeleton.rest.size(); ++j) {
    const Transform& rest = skeleton.rest[j];
    if (!finite(rest))
      findings.add("rest pose", element("rest", j) + " is not finite");
    else if (std::abs(rest.rotation.norm() - 1.0) > 1e-6)
      findings.add("rest pose", element("rest", j) + " has a rotation that is not of unit length");
  }
}

void check_skin(Findings& findings, const Asset& asset) {
  const SkinWeights& skin = asset.skin;
  if (skin.offsets.empty() || skin.offsets.front() != 0 || skin.offsets.back() != skin.influences.size()) {
    findings.add("skin rows", "skin offsets do not span the influences");
    return;
  }
  check_length(findings, "skin rows", skin.rows(), asset.mesh.vertices.size(), false);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    if (skin.offsets[v + 1] < skin.offsets[v] || skin.offsets[v + 1] > skin.influences.size()) {
      findings.add("skin rows", element("skin offsets", v + 1) + " is out of order");
      return;
    }
  }
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    double sum = 0.0;
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      const Influence& influence = skin.row(v)[i];
      if (influence.joint < 0 || static_cast<std::size_t>(influence.joint) >= asset.skeleton.size()) {
        findings.add("skin joints", "vertex " + std::to_string(v) + " is bound to joint " +
                                        std::to_string(influence.joint) + " of " +
                                        std::to_string(asset.skeleton.size()));
      }
      if (!(influence.weight > 0.0f))
        findings.add("skin weights", "vertex " + std::to_string(v) + " has a weight that is not positive");
      if (i > 0 && skin.row(v)[i - 1].weight < influence.weight)
        findings.add("skin order", "vertex " + std::to_string(v) + " does not list its heaviest joint first");
      for (std::size_t k = 0; k < i; ++k) {
        if (skin.row(v)[k].joint == influence.joint)
          findings.add("skin joints repeated",
                       "vertex " + std::to_string(v) + " names joint " + std::to_string(influence.joint) + " twice");
      }
      sum += influence.weight;
    }
    if (!(std::abs(sum - 1.0) < 1e-5))
      findings.add("skin sums", "weights of vertex " + std::to_string(v) + " sum to " + std::to_string(sum));
  }
}

void check_animation(Findings& findings, const Animation& animation, std::size_t joints) {
  const std::string where = "animation '" + animation.name + "' ";
  for (std::size_t c = 0; c < animation.channels.size(); ++c) {
    const Channel& channel = animation.channels[c];
    if (channel.joint < 0 || static_cast<std::size_t>(channel.joint) >= joints) {
      findings.add("animation joints", where + element("channels", c) + " moves joint " +
                                           std::to_string(channel.joint) + " of " + std::to_string(joints));
    }
    const std::size_t width = (channel.path == ChannelPath::kRotation ? std::size_t{4} : std::size_t{3}) *
                              (channel.interpolation == Interpolation::kCubicSpline ? std::size_t{3} : std::size_t{1});
    if (channel.times.empty()) findings.add("animation keys", where + element("channels", c) + " has no keys");
    if (channel.values.size() != width * channel.times.size())
      findings.add("animation keys", where + element("channels", c) + " has " + std::to_string(channel.values.size()) +
                                         " values for " + std::to_string(channel.times.size()) + " keys");
    for (std::size_t k = 0; k < channel.times.size(); ++k) {
      const double t = channel.times[k];
      if (!std::isfinite(t) || t < 0.0 || (k > 0 && !(t > channel.times[k - 1]))) {
        findings.add("animation times", where + element("channels", c) +
                                            " has times that do not increase from 0 at key " + std::to_string(k));
        break;
      }
    }
    for (const double value : channel.values) {
      if (std::isfinite(value)) continue;
      findings.add("animation values", where + element("channels", c) + " has a value that is not finite");
      break;
    }
  }
}

}  // namespace

std::vector<std::string> validate(const Asset& asset, std::size_t at_most, bool require_rig) {
  Findings findings(at_most);
  const bool has_skin = asset.skin.offsets.size() != 1 || !asset.skin.influences.empty();
  const bool has_skeleton = asset.skeleton.size() > 0, has_mesh = !asset.mesh.vertices.empty();
  if (require_rig || has_mesh || !has_skeleton || !asset.mesh.faces.empty())
    check_mesh(findings, asset, require_rig || has_skin);
  if (require_rig || has_skeleton || has_skin) check_skeleton(findings, asset.skeleton);
  if (require_rig || has_skin) check_skin(findings, asset);
  for (const Animation& animation : asset.animations) check_animation(findings, animation, asset.skeleton.size());
  return findings.take();
}

void apply(const Similarity& similarity, Asset& asset) {
  const double scale = similarity.scale;
  for (Eigen::Vector3f& vertex : asset.mesh.vertices)
    vertex = (scale * vertex.cast<double>() + similarity.offset).cast<float>();
  Skeleton& skeleton = asset.skeleton;
  // S · W · diag(1/s): positions move with the object, orientation and scale of each joint stay. Relative to the
  // parent that is a pure scaling of translations; only the root also takes the offset.
  for (Eigen::Matrix4d& bind : skeleton.bind)
    bind.topRightCorner<3, 1>() = scale * bind.topRightCorner<3, 1>() + similarity.offset;
  const auto offset_of = [&](std::size_t joint) {
    return skeleton.parents[joint] < 0 ? similarity.offset : Eigen::Vector3d(Eigen::Vector3d::Zero());
  };
  for (std::size_t j = 0; j < skeleton.rest.size(); ++j)
    skeleton.rest[j].translation = scale * skeleton.rest[j].translation + offset_of(j);
  for (Animation& animation : asset.animations) {
    for (Channel& channel : animation.channels) {
      if (channel.path != ChannelPath::kTranslation) continue;
      const Eigen::Vector3d offset = offset_of(static_cast<std::size_t>(channel.joint));
      const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
      for (std::size_t i = 0; i < channel.values.size(); ++i) {
        // Of a cubic key's three vectors only the middle one is a position; tangents do not take the offset.
        const bool tangent = cubic && (i / 3) % 3 != 1;
        channel.values[i] = scale * channel.values[i] + (tangent ? 0.0 : offset[static_cast<Eigen::Index>(i % 3)]);
      }
    }
  }
}

Similarity normalize(Asset& asset) {
  const Box box = bounding_box(asset.mesh.vertices);
  if (box.empty()) throw InputError(asset.name, "mesh", "cannot normalise a mesh without vertices");
  const double side = box.longest_side();
  if (!std::isfinite(side) || !box.center().allFinite()) throw InputError(asset.name, "mesh", "a vertex is not finite");
  if (!(side > 0.0)) throw InputError(asset.name, "mesh", "cannot normalise a mesh without extent");
  Similarity similarity;
  similarity.scale = 1.0 / side;
  similarity.offset = -box.center() / side;
  apply(similarity, asset);
  return similarity;
}

std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const std::vector<Eigen::Matrix4d>& world) {
  std::vector<Eigen::Matrix<double, 3, 4>> matrices(world.size());
  for (std::size_t j = 0; j < world.size(); ++j)
    matrices[j] = (world[j] * asset.skeleton.bind[j].inverse()).topRows<3>();
  std::vector<Eigen::Vector3f> posed(asset.mesh.vertices.size());
  for (std::size_t v = 0; v < posed.size(); ++v) {
    const Eigen::Vector4d vertex = asset.mesh.vertices[v].cast<double>().homogeneous();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      sum += static_cast<double>(influence.weight) * (matrices[at(influence.joint)] * vertex);
    }
    posed[v] = sum.cast<float>();
  }
  return posed;
}

std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const Pose& pose) {
  return skin_vertices(asset, forward_kinematics(asset.skeleton.parents, pose));
}

}  // namespace anigen
