#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/prepare/augment/pose_checks.h"

namespace anigen::prepare {
namespace {

double rounded(double value) { return std::isfinite(value) ? std::round(value * 1e6) / 1e6 : 0.0; }

std::string sentence(const char* what, double value, const char* bound, double limit) {
  char text[160];
  std::snprintf(text, sizeof text, "%s %.3g, %s %.3g", what, value, bound, limit);
  return text;
}

// Written so that a measure that is not a number is broken, too.
std::string within(const char* what, double value, double low, double high) {
  if (!(value >= low)) return sentence(what, value, "at least", low);
  if (!(value <= high)) return sentence(what, value, "at most", high);
  return "";
}

}  // namespace

void PoseLimits::validate() const {
  const std::pair<const char*, double> all[] = {
      {"least_change", least_change},       {"least_box", least_box},     {"most_box", most_box},
      {"least_thickness", least_thickness}, {"least_area", least_area},   {"most_area", most_area},
      {"least_volume", least_volume},       {"most_volume", most_volume}, {"most_shrunk", most_shrunk},
      {"most_stretched", most_stretched},   {"most_buried", most_buried}};
  for (const auto& [name, value] : all) {
    if (!(value >= 0.0)) throw InputError("", std::string("limits.") + name, "must be a number ≥ 0");
  }
  if (!(least_box > 0.0)) throw InputError("", "limits.least_box", "must be above 0: a point cannot be normalised");
  if (!(least_scale > 0.0)) throw InputError("", "limits.least_scale", "must be above 0");
}

Json to_json(const PoseMeasures& measures) {
  Json json;
  json["finite"] = measures.finite;
  json["scale"] = rounded(measures.scale);
  json["change"] = rounded(measures.change);
  json["box_ratio"] = rounded(measures.box_ratio);
  json["thickness_ratio"] = rounded(measures.thickness_ratio);
  json["area_ratio"] = rounded(measures.area_ratio);
  json["volume_ratio"] = measures.volume_ratio ? Json(rounded(*measures.volume_ratio)) : Json();
  json["shrunk_share"] = rounded(measures.shrunk_share);
  json["stretched_share"] = rounded(measures.stretched_share);
  json["buried_share"] = rounded(measures.buried_share);
  return json;
}

Json to_json(const PoseLimits& limits) {
  Json json;
  json["least_scale"] = limits.least_scale;
  json["least_change"] = limits.least_change;
  json["box"] = {limits.least_box, limits.most_box};
  json["least_thickness"] = limits.least_thickness;
  json["area"] = {limits.least_area, limits.most_area};
  json["volume"] = {limits.least_volume, limits.most_volume};
  json["most_shrunk"] = limits.most_shrunk;
  json["most_stretched"] = limits.most_stretched;
  json["most_buried"] = limits.most_buried;
  return json;
}

std::string broken_limit(const PoseMeasures& measures, const PoseLimits& limits) {
  if (!measures.finite) return "not finite: a vertex is nowhere, or a thousand times as far as the object is long";
  constexpr double kAny = 1e300;
  for (std::string problem : {
           within("vanished: scale, of the source's,", measures.scale, limits.least_scale, kAny),
           within("unchanged: vertices move by", measures.change, limits.least_change, kAny),
           within("bounding box: longest side, of the source's,", measures.box_ratio, limits.least_box,
                  limits.most_box),
           within("bounding box: thickness, of the source's,", measures.thickness_ratio, limits.least_thickness, kAny),
           within("surface: area, of the source's,", measures.area_ratio, limits.least_area, limits.most_area),
           within("volume: of the source's,", measures.volume_ratio.value_or(1.0), limits.least_volume,
                  limits.most_volume),
           within("collapsed: share of the surface with almost no area left", measures.shrunk_share, 0.0,
                  limits.most_shrunk),
           within("torn: share of the surface with an edge four times as long", measures.stretched_share, 0.0,
                  limits.most_stretched),
           within("buried: share of the surface that vanished into other parts", measures.buried_share, 0.0,
                  limits.most_buried),
       }) {
    if (!problem.empty()) return problem;
  }
  return "";
}

}  // namespace anigen::prepare
