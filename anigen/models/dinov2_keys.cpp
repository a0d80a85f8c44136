#include "anigen/models/dinov2_keys.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <utility>

namespace anigen::models {
namespace {

using Names = std::pair<const char*, const char*>;  // transformers, hub

constexpr std::array<Names, 6> kOutside = {{{"embeddings.cls_token", "cls_token"},
                                            {"embeddings.mask_token", "mask_token"},
                                            {"embeddings.register_tokens", "register_tokens"},
                                            {"embeddings.position_embeddings", "pos_embed"},
                                            {"embeddings.patch_embeddings.projection.", "patch_embed.proj."},
                                            {"layernorm.", "norm."}}};

constexpr std::array<Names, 8> kInBlocks = {{{"norm1.", "norm1."},
                                             {"norm2.", "norm2."},
                                             {"attention.output.dense.", "attn.proj."},
                                             {"layer_scale1.lambda1", "ls1.gamma"},
                                             {"layer_scale2.lambda1", "ls2.gamma"},
                                             {"mlp.fc", "mlp.fc"},
                                             {"mlp.weights_in.", "mlp.w12."},
                                             {"mlp.weights_out.", "mlp.w3."}}};

constexpr std::array<const char*, 3> kProjections = {"query", "key", "value"};  // in the order of the rows of qkv

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

// Replaces the first prefix of the table that fits. @return whether one did
template <std::size_t N>
bool rename(std::string& key, const std::array<Names, N>& table) {
  for (const auto& [from, to] : table) {
    if (!starts_with(key, from)) continue;
    key = to + key.substr(std::string(from).size());
    return true;
  }
  return false;
}

// "encoder.layer.3.norm1.weight" → "blocks.3." and "norm1.weight".
bool split_block(const std::string& key, std::string& block, std::string& rest) {
  const std::string prefix = "encoder.layer.";
  if (!starts_with(key, prefix)) return false;
  const std::size_t dot = key.find('.', prefix.size());
  if (dot == std::string::npos) return false;
  block = "blocks." + key.substr(prefix.size(), dot + 1 - prefix.size());
  rest = key.substr(dot + 1);
  return true;
}

// One of the three projections of a block, under the key of the joined array.
struct Part {
  std::string joined;  // "blocks.3.attn.qkv.weight"
  std::size_t place;   // 0 query, 1 key, 2 value
};

bool is_projection(const std::string& block, const std::string& rest, Part& part) {
  for (std::size_t i = 0; i < kProjections.size(); ++i) {
    const std::string prefix = std::string("attention.attention.") + kProjections[i] + ".";
    if (!starts_with(rest, prefix)) continue;
    part = {block + "attn.qkv." + rest.substr(prefix.size()), i};
    return true;
  }
  return false;
}

using Triple = std::array<std::pair<std::string, io::NdArray>, 3>;  // under their own keys; empty key: absent

bool fit_together(const Triple& triple) {
  return std::all_of(triple.begin(), triple.end(), [&](const auto& part) {
    return !part.first.empty() && part.second.dtype == triple[0].second.dtype && !part.second.shape.empty() &&
           part.second.shape == triple[0].second.shape;
  });
}

io::NdArray joined(const Triple& triple) {
  io::NdArray all = triple[0].second;
  all.shape[0] *= 3;
  for (std::size_t i = 1; i < triple.size(); ++i) {
    const auto& bytes = triple[i].second.bytes;
    all.bytes.insert(all.bytes.end(), bytes.begin(), bytes.end());
  }
  return all;
}

}  // namespace

io::NamedArrays to_hub_keys(io::NamedArrays arrays) {
  io::NamedArrays renamed;
  std::map<std::string, Triple> projections;
  for (auto& [key, array] : arrays) {
    std::string block, rest;
    Part part;
    if (!split_block(key, block, rest)) {
      rename(key, kOutside);
    } else if (is_projection(block, rest, part)) {
      projections[part.joined][part.place] = {key, std::move(array)};
      continue;
    } else if (rename(rest, kInBlocks)) {
      key = block + rest;
    }
    renamed.emplace_back(std::move(key), std::move(array));
  }
  for (auto& [key, triple] : projections) {
    if (fit_together(triple)) {
      renamed.emplace_back(key, joined(triple));
      continue;
    }
    for (auto& [own, array] : triple) {
      if (!own.empty()) renamed.emplace_back(own, std::move(array));
    }
  }
  return renamed;
}

}  // namespace anigen::models
