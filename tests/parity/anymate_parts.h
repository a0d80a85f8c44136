#pragma once
#include "anigen/anymate/heads.h"
#include "tests/parity/parts.h"

namespace anigen::test {

inline std::int64_t anymate_size(const Fixture& fixture, const char* key) {
  return fixture.config().at(key).get<std::int64_t>();
}

/// Parts that the heads share.
inline anymate::HeadOptions anymate_head(const Fixture& fixture) {
  anymate::HeadOptions options;
  options.width = anymate_size(fixture, "width");
  options.heads = anymate_size(fixture, "heads");
  options.num_freqs = fixture.config().value("num_freqs", options.num_freqs);
  options.qkv_bias = fixture.config().value("qkv_bias", options.qkv_bias);
  return options;
}

/// Fills a module with all parameters of a fixture, every key must match, and puts it into evaluation.
template <typename Module>
void load_all(Module& module, const Fixture& fixture) {
  load_whole(module, fixture);
  module->eval();
}

/// An input that asks for its gradient.
inline torch::Tensor input_with_gradient(const Fixture& fixture, const char* name) {
  return fixture.input(name).requires_grad_(true);
}

/// An input [B] of counts.
inline std::vector<std::int64_t> anymate_counts(const Fixture& fixture, const char* name) {
  const torch::Tensor counts = fixture.host_input(name).to(torch::kInt64).contiguous();
  return {counts.data_ptr<std::int64_t>(), counts.data_ptr<std::int64_t>() + counts.numel()};
}

}  // namespace anigen::test
