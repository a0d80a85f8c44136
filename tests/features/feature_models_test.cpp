#include "anigen/features/feature_models.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/models/dinov2.h"
#include "anigen/models/state_dict.h"
#include "tests/support/paths.h"

namespace anigen::features {
namespace {

std::string refusal(const prepare::FeatureOptions& options) {
  try {
    make_feature_extractor(options);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(FeatureModels, SurfaceNeedsNothing) {
  EXPECT_EQ(make_feature_extractor({"surface", {}, "cpu"})->name(), "surface");
  EXPECT_NE(refusal({"surface", "weights.pth", "cpu"}).find("takes no weights"), std::string::npos);
}

TEST(FeatureModels, ListsSurfaceAndThePublishedModels) {
  const std::vector<std::string> names = feature_models();
  EXPECT_EQ(names.front(), "surface");
  EXPECT_EQ(std::count(names.begin(), names.end(), "dinov2_vitl14_reg"), 1);
}

TEST(FeatureModels, DinoWithoutWeightsSaysHowToGiveThem) {
  const std::string message = refusal({"dinov2_vitl14_reg", {}, "cpu"});
  for (const char* word : {"--feature-weights", "dinov2_vitl14_reg4_pretrain.pth", "surface"}) {
    EXPECT_NE(message.find(word), std::string::npos) << message;
  }
  EXPECT_NE(refusal({"dinov2_vits14", {}, "cpu"}).find("dinov2_vits14_pretrain.pth"), std::string::npos);
}

TEST(FeatureModels, UnknownNamesAndFilesAndDevices) {
  EXPECT_NE(refusal({"dinov2_vitl14_re", {}, "cpu"}).find("'dinov2_vitl14_reg'"), std::string::npos);
  EXPECT_NE(refusal({"surfaces", {}, "cpu"}).find("'surface'"), std::string::npos);
  EXPECT_NE(refusal({"", {}, "cpu"}).find("surface"), std::string::npos);
  EXPECT_NE(refusal({"dinov2_vits14", "absent.pth", "cpu"}).find("absent.pth"), std::string::npos);
  EXPECT_NE(refusal({"dinov2_vits14", "absent.pth", "toaster"}).find("toaster"), std::string::npos);
}

// A safetensors file with the tensors of a published model, all zero: a hole, so that it costs no disk.
void write_zeros(const std::filesystem::path& path, const std::string& model) {
  Json header;
  std::uint64_t end = 0;
  const models::Dinov2 empty(models::Dinov2Options::named(model));
  for (const models::StateEntry& entry : models::state_entries(*empty)) {
    const std::uint64_t begin = end;
    end += static_cast<std::uint64_t>(entry.tensor.nbytes());
    header[entry.key] = {{"dtype", "F32"}, {"shape", entry.tensor.sizes().vec()}, {"data_offsets", {begin, end}}};
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');
  std::ofstream stream(path, std::ios::binary);
  for (int byte = 0; byte < 8; ++byte) stream.put(static_cast<char>(text.size() >> (8 * byte) & 0xFF));
  stream << text;
  stream.close();
  std::filesystem::resize_file(path, 8 + text.size() + end);
}

// The whole way from a file of published size to an extractor and its fingerprint.
TEST(FeatureModels, PublishedSizeFromAFile) {
  const test::TemporaryFolder folder;
  const std::filesystem::path weights = folder / "weights.safetensors";
  write_zeros(weights, "dinov2_vits14_reg");
  const auto extractor = make_feature_extractor({"dinov2_vits14_reg", weights, "cpu"});
  EXPECT_EQ(extractor->name(), "dinov2_vits14_reg");
  EXPECT_EQ(extractor->channels(), 384);
  EXPECT_TRUE(extractor->needs_views());

  const std::string message = refusal({"dinov2_vitb14_reg", weights, "cpu"});
  EXPECT_NE(message.find("[1, 1, 384]"), std::string::npos) << message;
  EXPECT_NE(message.find("[1, 1, 768]"), std::string::npos) << message;

  std::fstream(weights, std::ios::binary | std::ios::in | std::ios::out).seekp(-4, std::ios::end).write("\1", 1);
  const auto changed = make_feature_extractor({"dinov2_vits14_reg", weights, "cpu"});
  EXPECT_NE(changed->fingerprint(), extractor->fingerprint());
}

}  // namespace
}  // namespace anigen::features
