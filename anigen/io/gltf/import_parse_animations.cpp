#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

Interpolation parse_interpolation(const JsonPlace& sampler) {
  const std::string name = sampler.string_or("interpolation", "LINEAR");
  if (name == "LINEAR") return Interpolation::kLinear;
  if (name == "STEP") return Interpolation::kStep;
  if (name == "CUBICSPLINE") return Interpolation::kCubicSpline;
  sampler.at("interpolation").fail("unknown interpolation '" + name.substr(0, 20) + "'");
}

// Types and lengths of a sampler's accessors for the property they drive (glTF 2.0, section 3.11).
void check_sampler(const JsonPlace& sampler, const Document& document, const AnimationChannel& channel) {
  const Accessor& input = document.accessors[static_cast<std::size_t>(channel.input)];
  const Accessor& output = document.accessors[static_cast<std::size_t>(channel.output)];
  if (input.type != "SCALAR" || input.component != Component::kF32)
    sampler.at("input").fail("key times must be 32-bit float SCALARs");
  const bool rotation = channel.path == ChannelPath::kRotation;
  if (output.type != (rotation ? "VEC4" : "VEC3"))
    sampler.at("output").fail(std::string("expected ") + (rotation ? "VEC4" : "VEC3") + " values, found " +
                              output.type);
  if (output.component == Component::kU32) sampler.at("output").fail("key values cannot be 32-bit integers");
  const std::size_t parts = channel.interpolation == Interpolation::kCubicSpline ? 3 : 1;
  if (output.count != parts * input.count) {
    sampler.at("output").fail("there are " + std::to_string(output.count) + " values for " +
                              std::to_string(input.count) + " keys");
  }
}

AnimationEntry parse_animation(const JsonPlace& place, std::size_t nodes, const Document& document, Notes& notes) {
  AnimationEntry animation;
  animation.name = place.string_or("name", "");
  const JsonPlace channels = place.at("channels"), samplers = place.at("samplers");
  for (std::size_t i = 0; i < channels.size(); ++i) {
    const JsonPlace entry = channels[i];
    AnimationChannel channel;
    channel.pointer = entry.pointer();
    const JsonPlace sampler = samplers[static_cast<std::size_t>(entry.index("sampler", samplers.size(), "sampler"))];
    channel.input = sampler.index("input", document.accessors.size(), "accessor");
    channel.output = sampler.index("output", document.accessors.size(), "accessor");
    channel.interpolation = parse_interpolation(sampler);
    const JsonPlace target = entry.at("target");
    const std::string path = target.at("path").string();
    channel.node = target.index_or_none("node", nodes, "node");
    if (path == "weights") {
      notes.tally("morph_targets", "animation channels of morph targets were ignored");
      continue;
    }
    if (path == "pointer" || channel.node < 0) {
      notes.tally("dropped_channels", "animation channels without a target node were dropped");
      continue;
    }
    if (path == "translation")
      channel.path = ChannelPath::kTranslation;
    else if (path == "rotation")
      channel.path = ChannelPath::kRotation;
    else if (path == "scale")
      channel.path = ChannelPath::kScale;
    else
      target.at("path").fail("unknown path '" + path.substr(0, 20) + "'");
    check_sampler(sampler, document, channel);
    animation.channels.push_back(std::move(channel));
  }
  return animation;
}

}  // namespace

void parse_animations(const JsonPlace& root, Document& document, Notes& notes) {
  const auto list = root.find("animations");
  for (std::size_t i = 0; list && i < list->size(); ++i)
    document.animations.push_back(parse_animation((*list)[i], document.nodes.size(), document, notes));
}

}  // namespace anigen::io::gltf_import
