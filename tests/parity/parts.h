#pragma once
#include <string>

#include "anigen/nn/state_dict.h"
#include "tests/parity/fixture.h"

namespace anigen::test {

/// The parameters of one of several modules in a fixture, `param.<part>.*`, under the keys behind the part's name.
inline io::NamedArrays parameters_of(const Fixture& fixture, const std::string& part) {
  const std::string prefix = part + ".";
  io::NamedArrays found;
  for (const auto& [key, array] : fixture.parameters()) {
    if (key.compare(0, prefix.size(), prefix) == 0) found.emplace_back(key.substr(prefix.size()), array);
  }
  return found;
}

inline bool has(const io::NamedArrays& parameters, const std::string& key) {
  return io::find(parameters, key) != nullptr;
}

/// Options of a modulated block, dense or sparse, as its config and its parameters show them.
/// @param self_attention name of the module @tparam Options nn::ModulatedBlockOptions or its sparse counterpart
template <typename Options>
Options modulated_options(const Fixture& fixture, const std::string& part, const std::string& self_attention) {
  const Json& config = fixture.config();
  const io::NamedArrays parameters = parameters_of(fixture, part);
  Options options;
  options.channels = config.at("channels");
  options.context_channels = config.at("ctx_channels");
  options.num_heads = config.at("num_heads");
  options.mlp_ratio = config.at("mlp_ratio");
  options.qkv_bias = has(parameters, self_attention + ".to_qkv.bias");
  options.qk_rms_norm = has(parameters, self_attention + ".q_rms_norm.gamma");
  options.qk_rms_norm_cross = has(parameters, "cross_attn.q_rms_norm.gamma");
  options.share_mod = !has(parameters, "adaLN_modulation.1.weight");
  options.context_norm = has(parameters, "context_norm.weight");
  return options;
}

/// Fills a module with the parameters of a part, on the fixture's device; every key must match.
template <typename Module>
void load_part(Module& module, const Fixture& fixture, const std::string& part) {
  nn::load_state_dict(*module, parameters_of(fixture, part), nn::LoadMode::kStrict, fixture.name() + ".safetensors");
  module->to(fixture.device());
}

/// As above, with all parameters of the fixture.
template <typename Module>
void load_whole(Module& module, const Fixture& fixture) {
  nn::load_state_dict(*module, fixture.parameters(), nn::LoadMode::kStrict, fixture.name() + ".safetensors");
  module->to(fixture.device());
}

}  // namespace anigen::test
