#pragma once
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/flow.h"

namespace anigen::benchmarks {

/// The forward pass of SparseStructureFlow written out in LibTorch operations one after another, as eager code runs it:
/// separate layers, whole score matrices, softmax. Shares its weights with a model of ours. Knows what the published
/// duet config uses: one modulation per block, linear adapters both ways, normed queries and keys.
class PlainSparseStructureFlow {
 public:
  using Tensor = torch::Tensor;

  explicit PlainSparseStructureFlow(const sparse_structure::SparseStructureFlow& model) : options_(model->options()) {
    for (const nn::StateEntry& entry : nn::state_entries(*model.ptr())) weights_[entry.key] = entry.tensor;
  }

  sparse_structure::Velocity forward(const Tensor& x, const Tensor& x_skl, const Tensor& t, const Tensor& cond) const {
    const torch::Dtype torso = stored("blocks.0.mlp.mlp.0.weight").scalar_type();
    const Tensor context = cond.to(torso), e = embed_time(t, "").to(torso), e_skl = embed_time(t, "_skl").to(torso);
    Tensor h = enter(x, "").to(torso), h_skl = enter(x_skl, "_skl").to(torso);
    for (std::int64_t i = 0; i < options_.num_blocks; ++i) {
      const std::string index = std::to_string(i);
      const Tensor f = block("blocks." + index, h, e, context);
      const Tensor f_skl = block("blocks_skl." + index, h_skl, e_skl, context);
      h = f + linear("adapter_skl_to_ss_layers." + index, f_skl);
      h_skl = f_skl + linear("adapter_ss_to_skl_layers." + index, f);
    }
    return {leave(h, x, ""), leave(h_skl, x_skl, "_skl")};
  }

 private:
  const Tensor& stored(const std::string& key) const { return weights_.at(key); }

  Tensor linear(const std::string& key, const Tensor& x) const {
    return torch::linear(x, stored(key + ".weight"), stored(key + ".bias"));
  }

  static Tensor norm(const Tensor& x, double eps, const Tensor& weight = {}, const Tensor& bias = {}) {
    return torch::layer_norm(x.to(torch::kFloat32), {x.size(-1)}, weight, bias, eps).to(x.scalar_type());
  }

  Tensor embed_time(const Tensor& t, const std::string& suffix) const {
    const Tensor frequencies = torch::exp(torch::arange(128) * (-std::log(10000.0) / 128.0));
    const Tensor angles = t.unsqueeze(1) * frequencies;
    const std::string mlp = "t_embedder" + suffix + ".mlp.";
    return linear(mlp + "2", torch::silu(linear(mlp + "0", torch::cat({angles.cos(), angles.sin()}, 1))));
  }

  Tensor enter(const Tensor& x, const std::string& suffix) const {
    return linear("input_layer" + suffix, x.flatten(2).transpose(1, 2)) + stored("pos_emb" + suffix);
  }

  Tensor leave(const Tensor& h, const Tensor& x, const std::string& suffix) const {
    return linear("out_layer" + suffix, norm(h.to(x.scalar_type()), 1e-5)).transpose(1, 2).reshape(x.sizes());
  }

  static Tensor rms_norm(const Tensor& x, const Tensor& gamma) {
    const Tensor wide = x.to(torch::kFloat32), length = wide.square().sum(-1, true).sqrt().clamp_min(1e-12);
    return (wide / length * gamma * std::sqrt(static_cast<double>(gamma.size(1)))).to(x.scalar_type());
  }

  // [B, N, H, D] each → [B, N, C]
  static Tensor attention(const Tensor& q, const Tensor& k, const Tensor& v) {
    const double scale = 1.0 / std::sqrt(static_cast<double>(q.size(-1)));
    const Tensor scores = torch::matmul(q.transpose(1, 2) * scale, k.permute({0, 2, 3, 1}));
    return torch::matmul(torch::softmax(scores, -1), v.transpose(1, 2)).transpose(1, 2).flatten(2);
  }

  Tensor block(const std::string& key, const Tensor& input, const Tensor& e, const Tensor& context) const {
    constexpr double kEps = 1e-6;
    const std::int64_t heads = options_.heads(), width = input.size(2) / heads, batch = input.size(0);
    const auto chunks = linear(key + ".adaLN_modulation.1", torch::silu(e)).unsqueeze(1).chunk(6, -1);
    const std::string self = key + ".self_attn.", cross = key + ".cross_attn.";

    Tensor x = input, h = norm(x, kEps) * (chunks[1] + 1.0) + chunks[0];
    const auto qkv = linear(self + "to_qkv", h).view({batch, -1, 3, heads, width}).unbind(2);
    const Tensor q = rms_norm(qkv[0], stored(self + "q_rms_norm.gamma")),
                 k = rms_norm(qkv[1], stored(self + "k_rms_norm.gamma"));
    x = x + chunks[2] * linear(self + "to_out", attention(q, k, qkv[2]));

    h = norm(x, kEps, stored(key + ".norm2.weight"), stored(key + ".norm2.bias"));
    const Tensor query = linear(cross + "to_q", h).view({batch, -1, heads, width});
    const auto kv = linear(cross + "to_kv", context).view({batch, -1, 2, heads, width}).unbind(2);
    x = x + linear(cross + "to_out", attention(query, kv[0], kv[1]));

    h = norm(x, kEps) * (chunks[4] + 1.0) + chunks[3];
    return x + chunks[5] * linear(key + ".mlp.mlp.2", torch::gelu(linear(key + ".mlp.mlp.0", h), "tanh"));
  }

  sparse_structure::SparseStructureFlowOptions options_;
  std::map<std::string, Tensor> weights_;
};

}  // namespace anigen::benchmarks
