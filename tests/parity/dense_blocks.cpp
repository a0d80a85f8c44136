// Dense attention and the blocks made of it. Which options a module has follows from its parameters.
#include "anigen/nn/blocks.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

nn::Lora lora_of(const io::NamedArrays& parameters, const std::string& layer, const Json& config) {
  nn::Lora lora;
  if (!has(parameters, layer + ".lora_A")) return lora;
  lora.rank = config.at("lora_rank");
  lora.scale = config.at("lora_lr_rate");
  return lora;
}

void run_dense_attention(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  for (const std::string& part : fixture.outputs()) {
    const io::NamedArrays parameters = parameters_of(fixture, part);
    const bool cross = has(parameters, "to_kv.weight");
    nn::AttentionOptions options;
    options.channels = config.at("channels");
    options.num_heads = config.at("num_heads");
    if (cross) options.context_channels = config.at("ctx_channels");
    options.qkv_bias = has(parameters, cross ? "to_kv.bias" : "to_qkv.bias");
    options.qk_rms_norm = has(parameters, "q_rms_norm.gamma");
    options.x_is_query = cross && !has(parameters, "to_q.weight");
    options.lora_qkv = lora_of(parameters, cross ? "to_kv" : "to_qkv", config);
    options.lora_out = lora_of(parameters, "to_out", config);
    nn::DenseAttention attention(options);
    load_part(attention, fixture, part);
    fixture.check(part, attention->forward(fixture.input("x"), cross ? fixture.input("context") : Tensor()));
  }
}

nn::DenseBlockOptions block_options_of(const Fixture& fixture, const std::string& part,
                                       const std::string& self_attention) {
  const Json& config = fixture.config();
  const io::NamedArrays parameters = parameters_of(fixture, part);
  nn::DenseBlockOptions options;
  options.channels = config.at("channels");
  options.context_channels = config.at("ctx_channels");
  options.num_heads = config.at("num_heads");
  options.mlp_ratio = config.at("mlp_ratio");
  if (has(parameters, "res_mlp.mlp.0.weight")) options.out_channels = config.at("out_channels");
  options.self_attention = has(parameters, self_attention + ".to_qkv.weight");
  options.qkv_bias = has(parameters, self_attention + ".to_qkv.bias") || has(parameters, "cross_attn.to_kv.bias");
  options.qk_rms_norm = has(parameters, self_attention + ".q_rms_norm.gamma");
  options.qk_rms_norm_cross = has(parameters, "cross_attn.q_rms_norm.gamma");
  options.affine_norms = has(parameters, "norm2.weight");
  return options;
}

void run_dense_blocks(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const Tensor x = fixture.input("x"), context = fixture.input("context");

  nn::FeedForward feed_forward(config.at("channels").get<std::int64_t>(), config.at("out_channels").get<std::int64_t>(),
                               config.at("mlp_ratio").get<double>());
  load_part(feed_forward, fixture, "ffn");
  fixture.check("ffn", feed_forward->forward(x));

  for (const std::string part : {"block", "block_out"}) {
    nn::DenseBlock block(block_options_of(fixture, part, "attn"));
    load_part(block, fixture, part);
    fixture.check(part, block->forward(x));
  }
  for (const std::string part : {"cross", "cross_noself"}) {
    nn::DenseCrossBlock block(block_options_of(fixture, part, "self_attn"));
    load_part(block, fixture, part);
    fixture.check(part, block->forward(x, context));
  }

  nn::SkinCrossBlock block(block_options_of(fixture, "skin", "joint_attn"));
  load_part(block, fixture, "skin");
  const nn::SkinCrossBlockImpl::Output output = block->forward(x, fixture.input("joints"), fixture.input("skin"));
  fixture.check("skin_x", output.vertices);
  fixture.check("skin_j", output.joints);
}

nn::ModulatedBlockOptions modulated_options_of(const Fixture& fixture, const std::string& part,
                                               const std::string& self_attention) {
  const io::NamedArrays parameters = parameters_of(fixture, part);
  auto options = modulated_options<nn::ModulatedBlockOptions>(fixture, part, self_attention);
  options.lora_self = lora_of(parameters, self_attention + ".to_out", fixture.config());
  options.lora_cross = lora_of(parameters, "cross_attn.to_out", fixture.config());
  return options;
}

void run_modulated_blocks(Fixture& fixture) {
  for (const std::string part : {"block", "block_share"}) {
    const nn::ModulatedBlockOptions options = modulated_options_of(fixture, part, "attn");
    nn::ModulatedBlock block(options);
    load_part(block, fixture, part);
    fixture.check(part, block->forward(fixture.input("x"), fixture.input(options.share_mod ? "mod6" : "mod")));
  }

  nn::ModulatedCrossBlock with_lora(modulated_options_of(fixture, "cross_lora", "self_attn"));
  load_part(with_lora, fixture, "cross_lora");
  fixture.check("cross_lora", with_lora->forward(fixture.input("x"), fixture.input("mod"), fixture.input("context")));

  nn::ModulatedCrossBlock block(modulated_options_of(fixture, "cross", "self_attn"));
  load_part(block, fixture, "cross");
  const Tensor x = fixture.input("x").requires_grad_(), mod = fixture.input("mod").requires_grad_();
  const Tensor context = fixture.input("context").requires_grad_();
  const Tensor y = block->forward(x, mod, context);
  fixture.check("cross", y);
  (y * fixture.input("grad")).sum().backward();
  fixture.check("grad_x", x.grad());
  fixture.check("grad_mod", mod.grad());
  fixture.check("grad_context", context.grad());
  const std::string prefix = "grad_param.";
  const auto parameters = block->named_parameters();
  for (const std::string& name : fixture.outputs()) {
    if (name.compare(0, prefix.size(), prefix) == 0) fixture.check(name, parameters[name.substr(prefix.size())].grad());
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_dense_attention, anigen::test::run_dense_attention)
ANIGEN_DEVICE_PARITY(ops_dense_blocks, anigen::test::run_dense_blocks)
ANIGEN_DEVICE_PARITY(ops_dense_modulated_blocks, anigen::test::run_modulated_blocks)
