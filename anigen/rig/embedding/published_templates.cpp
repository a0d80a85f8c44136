#include "anigen/rig/embedding/embedding_template.h"

namespace anigen::rig {
namespace {

/// Adds joints by the name of their parent, and pairs of them.
class TemplateMaker {
 public:
  TemplateMaker(std::string name, const Eigen::Vector3d& box) {
    made_.name = std::move(name);
    made_.box = box;
  }

  void middle(const std::string& name, const std::string& parent, double y, double z, bool fat = false,
              bool guide = false) {
    add(name, parent, {0.0, y, z});
    made_.joints.back().fat = fat;
    made_.joints.back().guide = guide;
  }

  /// Left and right; the parent is a joint of the same side, or one in the middle.
  void pair(const std::string& name, const std::string& parent, const Eigen::Vector3d& left, bool foot = false,
            bool guide = false) {
    const bool sided = find("left_" + parent) >= 0;
    for (const bool is_left : {true, false}) {
      const std::string side = is_left ? "left_" : "right_";
      add(side + name, sided ? side + parent : parent, is_left ? left : Eigen::Vector3d(-left.x(), left.y(), left.z()));
      const int here = static_cast<int>(made_.joints.size()) - 1;
      made_.joints.back().mirror = is_left ? here + 1 : here - 1;
      made_.joints.back().foot = foot;
      made_.joints.back().guide = guide;
    }
  }

  TemplateSkeleton finish() { return std::move(made_); }

 private:
  int find(const std::string& name) const {
    for (std::size_t j = 0; j < made_.joints.size(); ++j) {
      if (made_.joints[j].name == name) return static_cast<int>(j);
    }
    return -1;
  }
  void add(const std::string& name, const std::string& parent, const Eigen::Vector3d& position) {
    TemplateJoint joint;
    joint.name = name;
    joint.position = position;
    joint.parent = find(parent);
    made_.joints.push_back(joint);
  }

  TemplateSkeleton made_;
};

}  // namespace

TemplateSkeleton biped_template() {
  TemplateMaker maker("biped", {0.92, 0.22, 1.0});
  maker.middle("hips", "", 0.0, 0.03, true);
  maker.middle("spine", "hips", 0.0, 0.12);
  maker.middle("chest", "spine", 0.0, 0.27, true);
  maker.middle("neck", "chest", 0.0, 0.33);
  maker.middle("head", "neck", 0.0, 0.38);
  maker.middle("head_tip", "head", 0.0, 0.44, true, true);
  maker.pair("upper_arm", "chest", {0.10, 0.0, 0.29});
  maker.pair("lower_arm", "upper_arm", {0.23, 0.0, 0.20});
  maker.pair("hand", "lower_arm", {0.35, -0.01, 0.115});
  maker.pair("hand_tip", "hand", {0.43, -0.02, 0.06}, false, true);
  maker.pair("upper_leg", "hips", {0.06, 0.0, 0.0});
  maker.pair("lower_leg", "upper_leg", {0.065, -0.005, -0.22});
  maker.pair("foot", "lower_leg", {0.07, 0.01, -0.43});
  maker.pair("toes", "foot", {0.075, -0.06, -0.475});
  maker.pair("toes_tip", "toes", {0.075, -0.09, -0.48}, true, true);
  return maker.finish();
}

TemplateSkeleton quadruped_template() {
  TemplateMaker maker("quadruped", {0.26, 1.0, 0.75});
  maker.middle("hips", "", 0.22, 0.08, true);
  maker.middle("spine", "hips", 0.06, 0.09);
  maker.middle("chest", "spine", -0.12, 0.08, true);
  maker.middle("neck", "chest", -0.22, 0.16);
  maker.middle("head", "neck", -0.31, 0.27);
  maker.middle("head_tip", "head", -0.38, 0.28, true, true);
  maker.middle("tail_0", "hips", 0.29, 0.10);
  maker.middle("tail_1", "tail_0", 0.36, 0.07);
  maker.middle("tail_2", "tail_1", 0.42, 0.03);
  maker.middle("tail_tip", "tail_2", 0.47, 0.0, false, true);
  maker.pair("front_upper_leg", "chest", {0.07, -0.14, 0.03});
  maker.pair("front_lower_leg", "front_upper_leg", {0.08, -0.11, -0.11});
  maker.pair("front_foot", "front_lower_leg", {0.08, -0.13, -0.26});
  maker.pair("front_toes", "front_foot", {0.08, -0.14, -0.37});
  maker.pair("front_toes_tip", "front_toes", {0.08, -0.17, -0.39}, true, true);
  maker.pair("hind_upper_leg", "hips", {0.07, 0.22, 0.03});
  maker.pair("hind_lower_leg", "hind_upper_leg", {0.08, 0.18, -0.11});
  maker.pair("hind_foot", "hind_lower_leg", {0.08, 0.25, -0.25});
  maker.pair("hind_toes", "hind_foot", {0.08, 0.23, -0.37});
  maker.pair("hind_toes_tip", "hind_toes", {0.08, 0.20, -0.39}, true, true);
  return maker.finish();
}

}  // namespace anigen::rig
