#include "anigen/eval/pair/pair_settings.h"

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

Json to_json(const IcpOptions& icp) {
  return {{"rotations", icp.rotations},
          {"principal_axes", icp.principal_axes},
          {"samples", icp.samples},
          {"score_samples", icp.score_samples},
          {"max_iterations", icp.max_iterations},
          {"variant", icp.variant == IcpVariant::kPointToPlane ? "point-to-plane" : "point-to-point"},
          {"scale", icp.similarity},
          {"trim", icp.trim},
          {"to_surface", icp.to_surface},
          {"exhaustive", icp.exhaustive}};
}

Json transport_json(const PairSettings& settings) {
  if (settings.transport == TransportMethod::kExact) return {{"solver", "exact"}};
  const TransportOptions options = transport_options(settings);
  return {{"solver", "sinkhorn"},
          {"epsilon_wasserstein", options.sinkhorn_options.epsilon},
          {"epsilon_gromov_wasserstein", options.entropic_options.epsilon}};
}

}  // namespace

TransportMethod parse_transport(const std::string& word) {
  if (word == "exact") return TransportMethod::kExact;
  if (word == "sinkhorn") return TransportMethod::kSinkhorn;
  throw InputError("", "--transport", "must be exact or sinkhorn, got \"" + word + "\"");
}

TransportOptions transport_options(const PairSettings& settings) {
  TransportOptions options;
  options.sinkhorn = settings.transport == TransportMethod::kSinkhorn;
  if (settings.epsilon) options.sinkhorn_options.epsilon = options.entropic_options.epsilon = *settings.epsilon;
  return options;
}

Json to_json(const PairSettings& settings) {
  Json json;
  json["normalization"] = to_string(settings.alignment.normalization);
  json["icp"] = settings.alignment.icp ? to_json(settings.alignment.registration) : Json(nullptr);
  json["seed"] = settings.seed;
  json["surface_samples"] = settings.surface_samples;
  json["image_size"] = settings.image_size;
  json["poses"] = settings.poses;
  json["motion_frames"] = settings.motion_frames;
  json["transport"] = transport_json(settings);
  json["groups"] = settings.groups;
  json["lpips"] = settings.lpips;
  json["categories"] = settings.categories;
  json["motion"] = settings.motion;
  return json;
}

void check(const PairSettings& settings) {
  check(settings.alignment.registration);
  static const std::set<std::string> kGroups = PairSettings().groups;
  for (const std::string& group : settings.groups) {
    if (kGroups.count(group) > 0) continue;
    std::string known;
    for (const std::string& name : kGroups) known += (known.empty() ? "" : ", ") + name;
    throw InputError("", group, "no such group of metrics; there are " + known);
  }
  if (settings.groups.empty()) throw InputError("", "", "no group of metrics to compute");
  const bool sinkhorn = settings.transport == TransportMethod::kSinkhorn;
  if (settings.epsilon && !sinkhorn)
    throw InputError("", "--epsilon", "is that of Sinkhorn's iterations: it goes with --transport sinkhorn");
  if (settings.epsilon && !(*settings.epsilon > 0.0 && *settings.epsilon <= 1.0))
    throw InputError("", "--epsilon", "is a share of the largest squared distance: above 0, at most 1");
  if (sinkhorn && !settings.wants("transport"))
    throw InputError("", "--transport", "is about the metrics of the group 'transport', which --metrics leaves out");
  if (settings.surface_samples == 0 || settings.surface_samples > 10'000'000)
    throw InputError("", "surface samples", "must be in 1 … 10,000,000");
  if (settings.image_size < 16 || settings.image_size > 4096)
    throw InputError("", "image size", "must be in 16 … 4096 pixels");
  if (settings.poses < 1 || settings.poses > 10000) throw InputError("", "poses", "must be in 1 … 10000");
  if (settings.motion_frames < 1 || settings.motion_frames > 10000)
    throw InputError("", "frames of a motion", "must be in 1 … 10000");
}

}  // namespace anigen::eval
