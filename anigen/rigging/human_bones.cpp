#include "anigen/rigging/human_bones.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/text.h"

namespace anigen::rigging {

namespace {

constexpr std::size_t kCentral = index_of(HumanBone::kLeftShoulder);
constexpr std::size_t kPerSide = 8, kPerHand = 15;
constexpr std::size_t kFingers = index_of(HumanBone::kLeftFirstFinger);

/// Names of a central bone, or of a bone of the left side, by customs; "#" stands for the side.
struct BoneWords {
  const char* vrm;
  const char* mixamo;
  const char* unreal;
};

constexpr BoneWords kTrunk[] = {{"hips", "Hips", "pelvis"},      {"spine", "Spine", "spine_01"},
                                {"chest", "Spine1", "spine_02"}, {"upperChest", "Spine2", "spine_03"},
                                {"neck", "Neck", "neck_01"},     {"head", "Head", "head"}};
constexpr BoneWords kLimbs[] = {{"Shoulder", "Shoulder", "clavicle"},
                                {"UpperArm", "Arm", "upperarm"},
                                {"LowerArm", "ForeArm", "lowerarm"},
                                {"Hand", "Hand", "hand"},
                                {"UpperLeg", "UpLeg", "thigh"},
                                {"LowerLeg", "Leg", "calf"},
                                {"Foot", "Foot", "foot"},
                                {"Toes", "ToeBase", "ball"}};
constexpr BoneWords kFingerWords[] = {{"Thumb", "HandThumb", "thumb"},
                                      {"Index", "HandIndex", "index"},
                                      {"Middle", "HandMiddle", "middle"},
                                      {"Ring", "HandRing", "ring"},
                                      {"Little", "HandPinky", "pinky"}};
constexpr const char* kPhalanges[] = {"Proximal", "Intermediate", "Distal"};
constexpr const char* kThumbPhalanges[] = {"Metacarpal", "Proximal", "Distal"};

const std::pair<const char*, NameStyle> kStyles[] = {{"chain", NameStyle::kChain},
                                                     {"vrm", NameStyle::kVrm},
                                                     {"mixamo", NameStyle::kMixamo},
                                                     {"unreal", NameStyle::kUnreal},
                                                     {"unity", NameStyle::kUnity}};

bool is_right(std::size_t bone) { return bone >= kFingers ? bone >= kFingers + kPerHand : bone >= kCentral + kPerSide; }

std::string capitalised(std::string word) {
  if (!word.empty() && word[0] >= 'a' && word[0] <= 'z') word[0] = static_cast<char>(word[0] - 'a' + 'A');
  return word;
}

/// The name that Unity's mapping begins from; thumbs there are Proximal, Intermediate, Distal like other fingers.
std::string sided_name(const BoneWords& words, const std::string& phalanx, int number, bool right, NameStyle style) {
  const std::string side = right ? "Right" : "Left";
  switch (style) {
    case NameStyle::kMixamo:
      return "mixamorig:" + side + words.mixamo + (number > 0 ? std::to_string(number) : "");
    case NameStyle::kUnreal:
      return words.unreal + (number > 0 ? "_0" + std::to_string(number) : std::string()) + (right ? "_r" : "_l");
    case NameStyle::kUnity:
      return side + words.vrm + phalanx;
    default:
      return (right ? "right" : "left") + std::string(words.vrm) + phalanx;
  }
}

}  // namespace

std::size_t mirrored_bone(std::size_t bone) {
  if (bone < kCentral) return bone;
  const std::size_t step = bone >= kFingers ? kPerHand : kPerSide;
  return is_right(bone) ? bone - step : bone + step;
}

bool is_required(std::size_t bone) {
  if (bone < kCentral)
    return bone == index_of(HumanBone::kHips) || bone == index_of(HumanBone::kSpine) ||
           bone == index_of(HumanBone::kHead);
  if (bone >= kFingers) return false;
  const std::size_t left = is_right(bone) ? mirrored_bone(bone) : bone;
  return left != index_of(HumanBone::kLeftShoulder) && left != index_of(HumanBone::kLeftToes);
}

std::size_t required_parent(std::size_t bone) {
  if (bone == index_of(HumanBone::kHips)) return kHumanBones;
  if (bone == index_of(HumanBone::kSpine)) return index_of(HumanBone::kHips);
  if (bone < kCentral) return index_of(HumanBone::kSpine);
  const int side = is_right(bone) ? 1 : 0;
  if (bone >= kFingers) {
    const std::size_t phalanx = (bone - kFingers) % 3;
    return phalanx > 0 ? bone - 1 : on_side(HumanBone::kLeftHand, side);
  }
  switch (static_cast<HumanBone>(side == 1 ? mirrored_bone(bone) : bone)) {
    case HumanBone::kLeftShoulder:
    case HumanBone::kLeftUpperArm:
      return index_of(HumanBone::kSpine);
    case HumanBone::kLeftUpperLeg:
      return index_of(HumanBone::kHips);
    default:
      return bone - 1;
  }
}

std::vector<std::string> name_style_words() {
  std::vector<std::string> words;
  for (const auto& [word, style] : kStyles) words.emplace_back(word);
  return words;
}

NameStyle parse_name_style(const std::string& word) {
  for (const auto& [known, style] : kStyles) {
    if (word == known) return style;
  }
  throw InputError("", "--names", "\"" + word + "\" is none of " + joined(name_style_words()));
}

std::string bone_name(std::size_t bone, NameStyle style) {
  if (bone < kCentral) {
    const BoneWords& words = kTrunk[bone];
    if (style == NameStyle::kMixamo) return std::string("mixamorig:") + words.mixamo;
    if (style == NameStyle::kUnreal) return words.unreal;
    return style == NameStyle::kUnity ? capitalised(words.vrm) : words.vrm;
  }
  const bool right = is_right(bone);
  const std::size_t left = right ? mirrored_bone(bone) : bone;
  if (left < kFingers) return sided_name(kLimbs[left - kCentral], "", 0, right, style);
  const std::size_t finger = (left - kFingers) / 3, phalanx = (left - kFingers) % 3;
  const bool of_thumb = finger == 0 && style == NameStyle::kVrm;
  return sided_name(kFingerWords[finger], of_thumb ? kThumbPhalanges[phalanx] : kPhalanges[phalanx],
                    static_cast<int>(phalanx) + 1, right, style);
}

}  // namespace anigen::rigging
