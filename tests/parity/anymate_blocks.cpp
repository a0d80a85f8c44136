// Embedders and attention blocks of Anymate's modules.
#include "anigen/anymate/blocks.h"
#include "anigen/anymate/denoisers.h"
#include "anigen/nn/embeddings.h"
#include "tests/parity/anymate_parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_anymate_embedders(Fixture& fixture) {
  const std::int64_t freqs = anymate_size(fixture, "num_freqs");
  const Tensor x = fixture.input("x"), t = fixture.input("t_int");
  fixture.check("fourier_pi", anymate::fourier_features(x, freqs, true));
  fixture.check("fourier", anymate::fourier_features(x, freqs, false));
  fixture.check("sh", anymate::spherical_harmonics(fixture.input("dirs")));
  fixture.check("temb", nn::timestep_features(t, anymate_size(fixture, "dim")));
  fixture.check("temb_odd", nn::timestep_features(t, anymate_size(fixture, "odd")));
}

// Number of layers of the stack in the fixture.
std::int64_t stack_layers(const Fixture& fixture) {
  const io::NamedArrays parameters = parameters_of(fixture, "transformer");
  std::int64_t layers = 0;
  while (has(parameters, "resblocks." + std::to_string(layers) + ".ln_1.weight")) ++layers;
  return layers;
}

void run_attention_blocks(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const std::int64_t width = anymate_size(fixture, "width"), heads = anymate_size(fixture, "heads");
  const bool bias = fixture.config().at("qkv_bias");
  const Tensor x = fixture.input("x"), data = fixture.input("data"), z = fixture.input("z"), xd = fixture.input("xd");
  const anymate::KeyMask mask_n(fixture.input("mask_n")), mask_m(fixture.input("mask_m"));

  anymate::ResidualAttention self(width, heads, bias);
  load_part(self, fixture, "self");
  fixture.check("self", self(x));
  fixture.check("self_mask", self(x, mask_n));
  anymate::ResidualCrossAttention cross(width, heads, bias, anymate_size(fixture, "data_width"));
  load_part(cross, fixture, "cross");
  fixture.check("cross", cross(x, data));
  fixture.check("cross_mask", cross(x, data, mask_m));
  anymate::ResidualStack stack(stack_layers(fixture), width, heads, bias);
  load_part(stack, fixture, "transformer");
  fixture.check("transformer", stack(x, mask_n));
  anymate::ResidualAttention denoiser(width, heads, has(parameters_of(fixture, "diff"), "attn.c_qkv.bias"));
  load_part(denoiser, fixture, "diff");
  fixture.check("diff", denoiser(x));

  anymate::ReadWriteOptions options;
  options.z_dim = width;
  options.x_dim = anymate_size(fixture, "x_dim");
  options.num_heads = anymate_size(fixture, "heads_diff");
  options.qkv_bias = has(parameters_of(fixture, "read"), "attn.wq.bias");
  anymate::StreamBlock read(options, "z", "x");
  load_part(read, fixture, "read");
  fixture.check("read", read(z, xd));
  anymate::StreamBlock compute(options, "z", "z");
  load_part(compute, fixture, "compute");
  fixture.check("compute", compute(z, z));
  anymate::StreamBlock write(options, "x", "z");
  load_part(write, fixture, "write");
  fixture.check("write", write(xd, z));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_anymate_embedders, anigen::test::run_anymate_embedders)
ANIGEN_DEVICE_PARITY(ops_anymate_attention_blocks, anigen::test::run_attention_blocks)
