#include "anigen/rigging/humanoid_names.h"

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <initializer_list>
#include <map>
#include <utility>

#include "anigen/asset/joint_side.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"

namespace anigen::rigging {

namespace {

using Kind = NamedBone::Kind;

/// Words in lower case, cut at everything that is no letter and where a new word begins in upper case.
std::vector<std::string> words_of_name(const std::string& name) {
  std::vector<std::string> words(1);
  char before = ' ';
  for (const char c : name) {
    const bool letter = std::isalpha(static_cast<unsigned char>(c)) != 0;
    const bool upper = std::isupper(static_cast<unsigned char>(c)) != 0;
    const bool begins = upper && std::islower(static_cast<unsigned char>(before)) != 0;
    if ((!letter || begins) && !words.back().empty()) words.emplace_back();
    if (letter) words.back() += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    before = c;
  }
  if (words.back().empty()) words.pop_back();
  return words;
}

bool is_one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::any_of(words.begin(), words.end(), [&word](const char* known) { return word == known; });
}

/// Words of rigs and programs that say nothing about the body.
bool says_nothing(const std::string& word) {
  return is_one_of(word, {"mixamorig", "def",   "deform",     "bip",   "biped", "bone",  "bones", "b",
                          "j",         "jnt",   "joint",      "rig",   "skin",  "sk",    "skel",  "cc",
                          "base",      "valve", "valvebiped", "valve", "c",     "m",     "bind",  "armature",
                          "character", "human", "l",          "r",     "left",  "right", "f"});
}

bool says_helper(const std::string& word) {
  return is_one_of(word,
                   {"end",      "tip",  "leaf",   "nub",   "twist", "roll",     "ik",         "fk",         "ctrl",
                    "control",  "pole", "target", "pt",    "mch",   "org",      "top",        "helper",     "slot",
                    "handslot", "null", "site",   "tweak", "share", "effector", "metacarpus", "metacarpal", "carpal"});
}

const std::map<std::string, HumanBone>& limb_words() {
  static const std::map<std::string, HumanBone> words = {
      {"shoulder", HumanBone::kLeftShoulder}, {"clavicle", HumanBone::kLeftShoulder},
      {"collar", HumanBone::kLeftShoulder},   {"clav", HumanBone::kLeftShoulder},
      {"upperarm", HumanBone::kLeftUpperArm}, {"uparm", HumanBone::kLeftUpperArm},
      {"arm", HumanBone::kLeftUpperArm},      {"armupper", HumanBone::kLeftUpperArm},
      {"bicep", HumanBone::kLeftUpperArm},    {"shldr", HumanBone::kLeftUpperArm},
      {"forearm", HumanBone::kLeftLowerArm},  {"lowerarm", HumanBone::kLeftLowerArm},
      {"armlower", HumanBone::kLeftLowerArm}, {"elbow", HumanBone::kLeftLowerArm},
      {"lowarm", HumanBone::kLeftLowerArm},   {"hand", HumanBone::kLeftHand},
      {"wrist", HumanBone::kLeftHand},        {"fist", HumanBone::kLeftHand},
      {"palm", HumanBone::kLeftHand},         {"upperleg", HumanBone::kLeftUpperLeg},
      {"upleg", HumanBone::kLeftUpperLeg},    {"thigh", HumanBone::kLeftUpperLeg},
      {"legupper", HumanBone::kLeftUpperLeg}, {"lowerleg", HumanBone::kLeftLowerLeg},
      {"leglower", HumanBone::kLeftLowerLeg}, {"calf", HumanBone::kLeftLowerLeg},
      {"shin", HumanBone::kLeftLowerLeg},     {"knee", HumanBone::kLeftLowerLeg},
      {"lowleg", HumanBone::kLeftLowerLeg},   {"leg", HumanBone::kLeftLowerLeg},
      {"foot", HumanBone::kLeftFoot},         {"ankle", HumanBone::kLeftFoot},
      {"toe", HumanBone::kLeftToes},          {"toes", HumanBone::kLeftToes},
      {"toebase", HumanBone::kLeftToes},      {"ball", HumanBone::kLeftToes}};
  return words;
}

/// Number of a finger, thumb 0 to little 4, or -1.
int finger_of(std::string word) {
  for (const char* in_front : {"hand", "finger"}) {
    if (word.rfind(in_front, 0) == 0) word = word.substr(std::string(in_front).size());
  }
  for (const char* behind : {"finger", "proximal", "intermediate", "distal"}) {
    const std::string text = behind;
    if (word.size() > text.size() && word.compare(word.size() - text.size(), text.size(), text) == 0)
      word = word.substr(0, word.size() - text.size());
  }
  if (word == "thumb") return 0;
  if (word == "index") return 1;
  if (word == "middle" || word == "mid") return 2;
  if (word == "ring") return 3;
  return word == "pinky" || word == "little" || word == "small" ? 4 : -1;
}

std::size_t depth_of(const std::vector<int>& parents, std::size_t joint) {
  std::size_t depth = 0;
  for (int j = parents[joint]; j >= 0; j = parents[at(j)]) ++depth;
  return depth;
}

}  // namespace

bool names_helper(const std::string& name) {
  const std::vector<std::string> words = words_of_name(name);
  return std::any_of(words.begin(), words.end(), says_helper);
}

NamedBone named_bone(const std::string& name) {
  if (names_helper(name)) return {};
  const SidedName sided = side_of_name(name);
  // Without the side; a name without one keeps the upper case that tells words apart.
  std::string body;
  for (const std::string& word : words_of_name(sided.side != 0 ? sided.stem : name)) {
    if (!says_nothing(word)) body += word;
  }
  if (sided.side == 0) {
    if (body == "hips" || body == "hip" || body == "pelvis") return {Kind::kCentral, HumanBone::kHips, 0};
    if (body == "neck") return {Kind::kCentral, HumanBone::kNeck, 0};
    if (body == "head") return {Kind::kCentral, HumanBone::kHead, 0};
    return {};
  }
  const int side = sided.side > 0 ? 0 : 1;
  const auto limb = limb_words().find(body);
  if (limb != limb_words().end()) return {Kind::kLimb, limb->second, side};
  const int finger = finger_of(body);
  if (finger < 0) return {};
  return {Kind::kFinger, static_cast<HumanBone>(index_of(HumanBone::kLeftFirstFinger) + 3 * at(finger)), side};
}

std::array<int, kHumanBones> joints_by_name(const std::vector<std::string>& names, const std::vector<int>& parents,
                                            const std::vector<char>& carries) {
  std::array<int, kHumanBones> joints;
  joints.fill(-1);
  std::map<std::size_t, std::vector<std::pair<std::size_t, int>>> fingers;  // by first phalanx: depth, joint
  const auto has_weight = [&carries](int j) { return carries.empty() || carries[at(j)] != 0; };
  for (std::size_t j = 0; j < names.size(); ++j) {
    const NamedBone named = named_bone(names[j]);
    const int joint = static_cast<int>(j);
    if (named.kind == Kind::kNone) continue;
    if (named.kind == Kind::kFinger) {
      if (has_weight(joint)) fingers[on_side(named.bone, named.side)].emplace_back(depth_of(parents, j), joint);
      continue;
    }
    int& known = joints[named.kind == Kind::kCentral ? index_of(named.bone) : on_side(named.bone, named.side)];
    // Parents come first, so that of "arm.001" and "arm.002" the upper one stays.
    if (known < 0 || (!has_weight(known) && has_weight(joint))) known = joint;
  }
  for (auto& [first, list] : fingers) {
    std::sort(list.begin(), list.end());
    for (std::size_t k = 0; k < std::min<std::size_t>(3, list.size()); ++k) joints[first + k] = list[k].second;
  }
  for (const int side : {0, 1}) {
    int& shoulder = joints[on_side(HumanBone::kLeftShoulder, side)];
    int& upper_arm = joints[on_side(HumanBone::kLeftUpperArm, side)];
    if (upper_arm < 0) std::swap(shoulder, upper_arm);  // "shoulder" and "elbow"
    // "leg" is the lower one beside "upleg", the upper one beside "knee" and "shin", which the map takes for it.
    int& upper_leg = joints[on_side(HumanBone::kLeftUpperLeg, side)];
    int& lower_leg = joints[on_side(HumanBone::kLeftLowerLeg, side)];
    if (upper_leg >= 0 || lower_leg < 0) continue;
    for (std::size_t j = at(lower_leg) + 1; j < names.size(); ++j) {
      const NamedBone named = named_bone(names[j]);
      if (named.kind != Kind::kLimb || named.bone != HumanBone::kLeftLowerLeg || named.side != side) continue;
      upper_leg = lower_leg;
      lower_leg = static_cast<int>(j);
      break;
    }
  }
  return joints;
}

}  // namespace anigen::rigging
