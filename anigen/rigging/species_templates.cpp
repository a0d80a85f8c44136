#include "anigen/rigging/species_templates.h"

#include <algorithm>
#include <functional>

#include "anigen/core/error.h"
#include "anigen/core/text.h"

namespace anigen::rigging {

namespace {

enum TemplateFlags : unsigned { kFat = 1, kFoot = 2, kGuide = 4 };

/// A joint in the middle of the body or, with x above 0, one on either side of it.
struct TemplateRow {
  const char *name, *parent;  ///< the parent of a pair is the joint of its side, where there is a pair of that name
  double x, y, z;
  unsigned flags = 0;
};

TemplateSkeleton made_of(const std::string& name, const Eigen::Vector3d& box, const std::vector<TemplateRow>& rows) {
  TemplateSkeleton made{name, {}, box};
  const auto find = [&](const std::string& wanted) {
    const auto found = std::find_if(made.joints.begin(), made.joints.end(),
                                    [&](const TemplateJoint& joint) { return joint.name == wanted; });
    return found == made.joints.end() ? -1 : static_cast<int>(found - made.joints.begin());
  };
  for (const TemplateRow& row : rows) {
    const bool pair = row.x > 0.0, sided = pair && find(std::string("left_") + row.parent) >= 0;
    for (const std::string side : {"left_", "right_"}) {
      const bool left = side == "left_";
      if (!pair && !left) continue;
      TemplateJoint joint;
      joint.name = (pair ? side : "") + row.name;
      joint.position = {left ? row.x : -row.x, row.y, row.z};
      joint.parent = find((sided ? side : "") + row.parent);
      if (pair) joint.mirror = static_cast<int>(made.joints.size()) + (left ? 1 : -1);
      joint.foot = (row.flags & kFoot) != 0;
      joint.fat = (row.flags & kFat) != 0;
      joint.guide = (row.flags & kGuide) != 0;
      made.joints.push_back(joint);
    }
  }
  return made;
}

TemplateSkeleton bird_made() {
  return made_of("bird", {1.0, 0.58, 0.26},
                 {{"hips", "", 0.0, 0.07, 0.05, kFat},
                  {"spine", "hips", 0.0, 0.0, 0.045},
                  {"chest", "spine", 0.0, -0.06, 0.045, kFat},
                  {"neck", "chest", 0.0, -0.12, 0.055},
                  {"head", "neck", 0.0, -0.18, 0.07},
                  {"beak_tip", "head", 0.0, -0.28, 0.05, kGuide},
                  {"tail_0", "hips", 0.0, 0.13, 0.055},
                  {"tail_1", "tail_0", 0.0, 0.2, 0.065},
                  {"tail_tip", "tail_1", 0.0, 0.285, 0.07, kGuide},
                  {"wing_0", "chest", 0.04, -0.05, 0.05},
                  {"wing_1", "wing_0", 0.12, -0.04, 0.085},
                  {"wing_2", "wing_1", 0.21, -0.04, 0.095},
                  {"wing_3", "wing_2", 0.35, 0.02, 0.095},
                  {"wing_tip", "wing_3", 0.49, 0.13, 0.08, kGuide},
                  {"upper_leg", "hips", 0.035, 0.07, 0.02},
                  {"lower_leg", "upper_leg", 0.03, 0.1, -0.04},
                  {"foot", "lower_leg", 0.028, 0.06, -0.1},
                  {"toes_tip", "foot", 0.027, -0.01, -0.115, kFoot | kGuide}});
}

TemplateSkeleton dragon_made() {
  return made_of("dragon", {1.0, 0.8, 0.22},
                 {{"hips", "", 0.0, -0.06, 0.02, kFat},
                  {"spine", "hips", 0.0, -0.13, 0.017},
                  {"chest", "spine", 0.0, -0.19, 0.014, kFat},
                  {"neck_0", "chest", 0.0, -0.25, 0.018},
                  {"neck_1", "neck_0", 0.0, -0.3, 0.025},
                  {"head", "neck_1", 0.0, -0.34, 0.03},
                  {"head_tip", "head", 0.0, -0.395, 0.01, kGuide},
                  {"tail_0", "hips", 0.0, 0.0, 0.018},
                  {"tail_1", "tail_0", 0.0, 0.085, 0.017},
                  {"tail_2", "tail_1", 0.0, 0.17, 0.019},
                  {"tail_3", "tail_2", 0.0, 0.25, 0.021},
                  {"tail_4", "tail_3", 0.0, 0.325, 0.025},
                  {"tail_tip", "tail_4", 0.0, 0.395, 0.03, kGuide},
                  {"wing_0", "chest", 0.055, -0.21, 0.025},
                  {"wing_1", "wing_0", 0.135, -0.2, 0.03},
                  {"wing_2", "wing_1", 0.215, -0.26, 0.024},
                  {"wing_3", "wing_2", 0.335, -0.265, 0.01},
                  {"wing_tip", "wing_3", 0.495, -0.25, -0.015, kGuide},
                  {"front_upper_leg", "chest", 0.036, -0.195, -0.005},
                  {"front_lower_leg", "front_upper_leg", 0.037, -0.165, -0.04},
                  {"front_foot", "front_lower_leg", 0.034, -0.178, -0.07},
                  {"front_toes_tip", "front_foot", 0.033, -0.215, -0.085, kFoot | kGuide},
                  {"hind_upper_leg", "hips", 0.038, -0.072, -0.002},
                  {"hind_lower_leg", "hind_upper_leg", 0.04, -0.08, -0.03},
                  {"hind_foot", "hind_lower_leg", 0.037, -0.058, -0.065},
                  {"hind_toes_tip", "hind_foot", 0.04, -0.095, -0.085, kFoot | kGuide}});
}

TemplateSkeleton fish_made() {
  return made_of("fish", {0.44, 1.0, 0.36},
                 {{"body", "", 0.0, -0.2, 0.0, kFat},
                  {"head", "body", 0.0, -0.31, 0.0},
                  {"head_tip", "head", 0.0, -0.48, 0.0, kGuide},
                  {"spine_0", "body", 0.0, -0.1, 0.0},
                  {"spine_1", "spine_0", 0.0, 0.0, 0.0},
                  {"spine_2", "spine_1", 0.0, 0.1, 0.0},
                  {"spine_3", "spine_2", 0.0, 0.2, 0.0},
                  {"tail_0", "spine_3", 0.0, 0.3, 0.0},
                  {"tail_1", "tail_0", 0.0, 0.4, 0.0},
                  {"tail_tip", "tail_1", 0.0, 0.49, 0.0, kGuide},
                  {"fin_0", "body", 0.07, -0.15, -0.05},
                  {"fin_1", "fin_0", 0.14, -0.137, -0.075},
                  {"fin_tip", "fin_1", 0.215, -0.125, -0.105, kGuide}});
}

TemplateSkeleton snake_made() {
  std::vector<TemplateRow> rows{{"neck", "", 0.0, -0.41, 0.0},
                                {"head", "neck", 0.0, -0.455, 0.0},
                                {"head_tip", "head", 0.0, -0.495, 0.0, kGuide}};
  static constexpr std::array<const char*, 16> kNames{"spine_0", "spine_1", "spine_2", "spine_3", "spine_4", "spine_5",
                                                      "spine_6", "spine_7", "spine_8", "spine_9", "tail_0",  "tail_1",
                                                      "tail_2",  "tail_3",  "tail_4",  "tail_tip"};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const double y = -0.355 + 0.85 * static_cast<double>(i) / (kNames.size() - 1);
    rows.push_back({kNames[i], i == 0 ? "neck" : kNames[i - 1], 0.0, y, 0.0, i + 1 == kNames.size() ? kGuide : 0U});
  }
  return made_of("snake", {0.08, 1.0, 0.08}, rows);
}

TemplateSkeleton spider_made() {
  return made_of("spider", {1.0, 0.73, 0.27},
                 {{"hips", "", 0.0, 0.13, -0.07, kFat},
                  {"abdomen", "hips", 0.0, 0.22, -0.065},
                  {"abdomen_tip", "abdomen", 0.0, 0.35, -0.055, kGuide},
                  {"thorax", "hips", 0.0, 0.075, -0.07, kFat},
                  {"head", "thorax", 0.0, 0.02, -0.07},
                  {"head_tip", "head", 0.0, -0.05, -0.07, kGuide},
                  {"leg_a_0", "thorax", 0.05, 0.035, -0.065},
                  {"leg_a_1", "leg_a_0", 0.12, -0.085, 0.1},
                  {"leg_a_2", "leg_a_1", 0.21, -0.275, 0.045},
                  {"leg_a_tip", "leg_a_2", 0.255, -0.355, -0.12, kFoot | kGuide},
                  {"leg_b_0", "thorax", 0.055, 0.07, -0.065},
                  {"leg_b_1", "leg_b_0", 0.22, -0.01, 0.025},
                  {"leg_b_2", "leg_b_1", 0.35, -0.13, -0.02},
                  {"leg_b_tip", "leg_b_2", 0.44, -0.23, -0.12, kFoot | kGuide},
                  {"leg_c_0", "thorax", 0.05, 0.1, -0.065},
                  {"leg_c_1", "leg_c_0", 0.215, 0.105, 0.035},
                  {"leg_c_2", "leg_c_1", 0.385, 0.085, -0.01},
                  {"leg_c_tip", "leg_c_2", 0.495, 0.07, -0.12, kFoot | kGuide},
                  {"leg_d_0", "thorax", 0.045, 0.125, -0.065},
                  {"leg_d_1", "leg_d_0", 0.19, 0.19, 0.095},
                  {"leg_d_2", "leg_d_1", 0.315, 0.28, 0.07},
                  {"leg_d_tip", "leg_d_2", 0.41, 0.355, -0.12, kFoot | kGuide}});
}

TemplateSkeleton kaiju_made() {
  return made_of("kaiju", {0.44, 1.0, 0.56},
                 {{"hips", "", 0.0, -0.2, -0.03, kFat},
                  {"spine", "hips", 0.0, -0.27, 0.0},
                  {"chest", "spine", 0.0, -0.35, 0.06, kFat},
                  {"neck_0", "chest", 0.0, -0.39, 0.12},
                  {"neck_1", "neck_0", 0.0, -0.405, 0.19},
                  {"head", "neck_1", 0.0, -0.42, 0.245},
                  {"head_tip", "head", 0.0, -0.495, 0.235, kGuide},
                  {"tail_0", "hips", 0.0, -0.13, -0.09},
                  {"tail_1", "tail_0", 0.0, -0.03, -0.105},
                  {"tail_2", "tail_1", 0.0, 0.09, -0.125},
                  {"tail_3", "tail_2", 0.0, 0.22, -0.145},
                  {"tail_4", "tail_3", 0.0, 0.36, -0.16},
                  {"tail_tip", "tail_4", 0.0, 0.49, -0.17, kGuide},
                  {"upper_arm", "chest", 0.06, -0.38, 0.09},
                  {"lower_arm", "upper_arm", 0.115, -0.38, 0.1},
                  {"hand", "lower_arm", 0.16, -0.39, 0.105},
                  {"hand_tip", "hand", 0.2, -0.4, 0.1, kGuide},
                  {"upper_leg", "hips", 0.065, -0.21, -0.045},
                  {"lower_leg", "upper_leg", 0.082, -0.28, -0.1},
                  {"foot", "lower_leg", 0.092, -0.225, -0.155},
                  {"toes", "foot", 0.097, -0.25, -0.225},
                  {"toes_tip", "toes", 0.098, -0.32, -0.25, kFoot | kGuide}});
}

TemplateSkeleton fox_made() {
  return made_of("fox", {0.15, 1.0, 0.5},
                 {{"hips", "", 0.0, 0.12, 0.065, kFat},
                  {"spine", "hips", 0.0, 0.0, 0.055},
                  {"chest", "spine", 0.0, -0.16, 0.06, kFat},
                  {"neck", "chest", 0.0, -0.26, 0.085},
                  {"head", "neck", 0.0, -0.35, 0.135},
                  {"head_tip", "head", 0.0, -0.49, 0.105, kGuide},
                  {"tail_0", "hips", 0.0, 0.18, 0.068},
                  {"tail_1", "tail_0", 0.0, 0.27, 0.069},
                  {"tail_2", "tail_1", 0.0, 0.37, 0.07},
                  {"tail_tip", "tail_2", 0.0, 0.49, 0.075, kGuide},
                  {"front_upper_leg", "chest", 0.04, -0.205, 0.01},
                  {"front_lower_leg", "front_upper_leg", 0.043, -0.205, -0.1},
                  {"front_foot", "front_lower_leg", 0.043, -0.205, -0.195},
                  {"front_toes", "front_foot", 0.043, -0.215, -0.225},
                  {"front_toes_tip", "front_toes", 0.043, -0.24, -0.235, kFoot | kGuide},
                  {"hind_upper_leg", "hips", 0.044, 0.1, 0.04},
                  {"hind_lower_leg", "hind_upper_leg", 0.046, 0.065, -0.045},
                  {"hind_foot", "hind_lower_leg", 0.046, 0.138, -0.138},
                  {"hind_toes", "hind_foot", 0.046, 0.12, -0.215},
                  {"hind_toes_tip", "hind_toes", 0.046, 0.09, -0.235, kFoot | kGuide}});
}

TemplateSkeleton horse_made() {
  return made_of("horse", {0.15, 1.0, 0.62},
                 {{"hips", "", 0.0, 0.1, 0.09, kFat},
                  {"spine", "hips", 0.0, -0.02, 0.088},
                  {"chest", "spine", 0.0, -0.18, 0.09, kFat},
                  {"neck_0", "chest", 0.0, -0.25, 0.135},
                  {"neck_1", "neck_0", 0.0, -0.315, 0.19},
                  {"head", "neck_1", 0.0, -0.38, 0.23},
                  {"head_tip", "head", 0.0, -0.495, 0.14, kGuide},
                  {"tail_0", "hips", 0.0, 0.17, 0.115},
                  {"tail_1", "tail_0", 0.0, 0.26, 0.116},
                  {"tail_2", "tail_1", 0.0, 0.36, 0.117},
                  {"tail_tip", "tail_2", 0.0, 0.49, 0.118, kGuide},
                  {"front_upper_leg", "chest", 0.055, -0.235, -0.01},
                  {"front_lower_leg", "front_upper_leg", 0.046, -0.227, -0.147},
                  {"front_foot", "front_lower_leg", 0.045, -0.215, -0.24},
                  {"front_toes", "front_foot", 0.046, -0.225, -0.28},
                  {"front_toes_tip", "front_toes", 0.046, -0.236, -0.305, kFoot | kGuide},
                  {"hind_upper_leg", "hips", 0.06, 0.12, 0.03},
                  {"hind_lower_leg", "hind_upper_leg", 0.061, 0.105, -0.03},
                  {"hind_foot", "hind_lower_leg", 0.061, 0.178, -0.145},
                  {"hind_toes", "hind_foot", 0.061, 0.188, -0.265},
                  {"hind_toes_tip", "hind_toes", 0.061, 0.182, -0.305, kFoot | kGuide}});
}

/// Templates by name, in the order they are listed to users.
const std::vector<std::pair<std::string, std::function<TemplateSkeleton()>>>& makers() {
  static const std::vector<std::pair<std::string, std::function<TemplateSkeleton()>>> all{
      {"biped", biped_template}, {"quadruped", quadruped_template},
      {"horse", horse_made},     {"fox", fox_made},
      {"bird", bird_made},       {"dragon", dragon_made},
      {"kaiju", kaiju_made},     {"fish", fish_made},
      {"snake", snake_made},     {"spider", spider_made}};
  return all;
}

}  // namespace

TemplateSkeleton biped_template() {
  return made_of("biped", {0.92, 0.22, 1.0},
                 {{"hips", "", 0.0, 0.0, 0.03, kFat},
                  {"spine", "hips", 0.0, 0.0, 0.12},
                  {"chest", "spine", 0.0, 0.0, 0.27, kFat},
                  {"neck", "chest", 0.0, 0.0, 0.33},
                  {"head", "neck", 0.0, 0.0, 0.38},
                  {"head_tip", "head", 0.0, 0.0, 0.44, kFat | kGuide},
                  {"upper_arm", "chest", 0.10, 0.0, 0.29},
                  {"lower_arm", "upper_arm", 0.23, 0.0, 0.20},
                  {"hand", "lower_arm", 0.35, -0.01, 0.115},
                  {"hand_tip", "hand", 0.43, -0.02, 0.06, kGuide},
                  {"upper_leg", "hips", 0.06, 0.0, 0.0},
                  {"lower_leg", "upper_leg", 0.065, -0.005, -0.22},
                  {"foot", "lower_leg", 0.07, 0.01, -0.43},
                  {"toes", "foot", 0.075, -0.06, -0.475},
                  {"toes_tip", "toes", 0.075, -0.09, -0.48, kFoot | kGuide}});
}

TemplateSkeleton quadruped_template() {
  return made_of("quadruped", {0.26, 1.0, 0.75},
                 {{"hips", "", 0.0, 0.22, 0.08, kFat},
                  {"spine", "hips", 0.0, 0.06, 0.09},
                  {"chest", "spine", 0.0, -0.12, 0.08, kFat},
                  {"neck", "chest", 0.0, -0.22, 0.16},
                  {"head", "neck", 0.0, -0.31, 0.27},
                  {"head_tip", "head", 0.0, -0.38, 0.28, kFat | kGuide},
                  {"tail_0", "hips", 0.0, 0.29, 0.10},
                  {"tail_1", "tail_0", 0.0, 0.36, 0.07},
                  {"tail_2", "tail_1", 0.0, 0.42, 0.03},
                  {"tail_tip", "tail_2", 0.0, 0.47, 0.0, kGuide},
                  {"front_upper_leg", "chest", 0.07, -0.14, 0.03},
                  {"front_lower_leg", "front_upper_leg", 0.08, -0.11, -0.11},
                  {"front_foot", "front_lower_leg", 0.08, -0.13, -0.26},
                  {"front_toes", "front_foot", 0.08, -0.14, -0.37},
                  {"front_toes_tip", "front_toes", 0.08, -0.17, -0.39, kFoot | kGuide},
                  {"hind_upper_leg", "hips", 0.07, 0.22, 0.03},
                  {"hind_lower_leg", "hind_upper_leg", 0.08, 0.18, -0.11},
                  {"hind_foot", "hind_lower_leg", 0.08, 0.25, -0.25},
                  {"hind_toes", "hind_foot", 0.08, 0.23, -0.37},
                  {"hind_toes_tip", "hind_toes", 0.08, 0.20, -0.39, kFoot | kGuide}});
}

std::vector<std::string> template_words() {
  std::vector<std::string> words;
  for (const auto& [word, make] : makers()) words.push_back(word);
  return words;
}

std::vector<std::string> usual_template_words() { return {"biped", "quadruped"}; }

TemplateSkeleton species_template(const std::string& word) {
  for (const auto& [name, make] : makers()) {
    if (name == word) return make();
  }
  throw InputError("", "--template", "\"" + word + "\" is none of " + joined(template_words(), ", "));
}

}  // namespace anigen::rigging
