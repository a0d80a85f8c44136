#include "anigen/rig/rigging_method.h"

#include <utility>

#include "anigen/core/error.h"

namespace anigen::rig {
namespace {

const std::vector<std::pair<std::string, RiggingMethod>>& known_methods() {
  static const std::vector<std::pair<std::string, RiggingMethod>> methods{
      {"nearest", {JointSource::kGiven, SkinBinding::kNearest}},
      {"geovoxel", {JointSource::kGiven, SkinBinding::kGeodesicVoxels}},
      {"heat", {JointSource::kGiven, SkinBinding::kHeat}},
      {"template", {JointSource::kTemplate, SkinBinding::kNearest}},
      {"curve", {JointSource::kCurve, SkinBinding::kGeodesicVoxels}},
      {"pinocchio", {JointSource::kPinocchio, SkinBinding::kHeat}},
  };
  return methods;
}

}  // namespace

RiggingMethod parse_rigging_method(const std::string& method, const std::string& skin) {
  std::string words;
  for (const auto& [word, known] : known_methods()) {
    words += (words.empty() ? "" : ", ") + word;
    if (word != method) continue;
    RiggingMethod result = known;
    if (skin == "none") {
      result.binding.reset();
    } else if (!skin.empty()) {
      result.binding = parse_skin_binding(skin);
    }
    return result;
  }
  throw InputError("", "--method", "\"" + method + "\" is none of " + words);
}

std::vector<std::string> rigging_method_words() {
  std::vector<std::string> words;
  for (const auto& [word, unused] : known_methods()) words.push_back(word);
  return words;
}

}  // namespace anigen::rig
