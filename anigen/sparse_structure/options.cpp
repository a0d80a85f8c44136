#include "anigen/sparse_structure/options.h"

#include "anigen/sparse_structure/layers.h"

namespace anigen::sparse_structure {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostChannels = 16384;
constexpr std::int64_t kMostResBlocks = 256;
constexpr std::int64_t kMostTokens = 1 << 20;
constexpr std::int64_t kMostLevels = 7;  // 64³ cells down to one
constexpr std::int64_t kNormGroups = 32;

}  // namespace

void SparseStructureCoderOptions::fields(ConfigFields& f) {
  f("latent_channels", latent_channels, {1, kMostChannels});
  f("latent_channels_skl", latent_channels_skl, {1, kMostChannels});
  f("num_res_blocks", num_res_blocks, {0, kMostResBlocks});
  f("num_res_blocks_middle", num_res_blocks_middle, {0, kMostResBlocks});
  f("channels", channels, kRequired);
  f("norm_type", norm_type, {"layer", "group"});
  f("use_fp16", use_fp16);
  f("encode_global", encode_global);
  f("encode_global_skl", encode_global_skl);
  f("global_token_num", global_token_num, {1, kMostTokens});
  f("global_token_num_skl", global_token_num_skl, {1, kMostTokens});
  f("use_pretrain_branch", use_pretrain_branch);
  f("freeze_pretrain_branch", freeze_pretrain_branch);
  f("modules_to_freeze", modules_to_freeze);
  f("normalize_z", normalize_z);
  f("normalize_z_skl", normalize_z_skl);
  f("normalize_scale", normalize_scale);
  f("normalize_norm", normalize_norm, {"l2", "l1"});
}

void SparseStructureCoderOptions::validate_channels(const OptionCheck& check) const {
  check(!channels.empty() && levels() <= kMostLevels, "channels",
        "expected 1 to " + std::to_string(kMostLevels) + " widths");
  for (const std::int64_t width : channels)
    check(width >= 1 && width <= kMostChannels, "channels", "bad width " + std::to_string(width));
}

void SparseStructureCoderOptions::validate_coder(const OptionCheck& check, std::int64_t coarsest) const {
  check(normalize_scale > 0.0, "normalize_scale", "must be above 0");
  check(coarsest % kGlobalTokenHeads == 0 || !(encode_global || encode_global_skl), "channels",
        "with encode_global the coarsest width must be a multiple of " + std::to_string(kGlobalTokenHeads) +
            " heads, found " + std::to_string(coarsest));
  check(norm_type != "group" || channels.back() % kNormGroups == 0, "norm_type",
        std::to_string(channels.back()) + " channels are not a multiple of " + std::to_string(kNormGroups) +
            " groups; use \"layer\"");
}

void SparseStructureEncoderOptions::fields(ConfigFields& f) {
  f("in_channels", in_channels, {1, kMostChannels});
  f("in_channels_skl", in_channels_skl, {1, kMostChannels});
  SparseStructureCoderOptions::fields(f);
  f("latent_denoising", latent_denoising);
  f("latent_denoising_skl", latent_denoising_skl);
}

void SparseStructureEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  validate_channels(check);
  validate_coder(check, channels.back());
}

void SparseStructureDecoderOptions::fields(ConfigFields& f) {
  f("out_channels", out_channels, {1, kMostChannels});
  f("out_channels_skl", out_channels_skl, {1, kMostChannels});
  SparseStructureCoderOptions::fields(f);
}

void SparseStructureDecoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  validate_channels(check);
  validate_coder(check, channels.front());
  const auto check_first_block = [&](bool global, std::int64_t latent, const char* key) {
    check(!global || (channels.front() + latent) % kGlobalTokenFirstHeads == 0, key,
          "with encode_global the first width and this must sum to a multiple of " +
              std::to_string(kGlobalTokenFirstHeads) + " heads");
  };
  check_first_block(encode_global, latent_channels, "latent_channels");
  check_first_block(encode_global_skl, latent_channels_skl, "latent_channels_skl");
}

}  // namespace anigen::sparse_structure
