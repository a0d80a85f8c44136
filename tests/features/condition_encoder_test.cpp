#include "anigen/features/condition_encoder.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "tests/support/paths.h"

namespace anigen::features {
namespace {

namespace fs = std::filesystem;

/// Published weights are looked for below the working directory.
class PublishedConditions : public testing::Test {
 protected:
  PublishedConditions() : before_(fs::current_path()) { fs::current_path(folder_.path()); }
  ~PublishedConditions() override { fs::current_path(before_); }

  static std::string message(const Json& args, std::int64_t channels = 384) {
    ConfigReader reader(args, "config.json", "/trainer/args");
    try {
      make_condition_encoder(reader, 518, channels, torch::kCPU);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  test::TemporaryFolder folder_;
  fs::path before_;
};

TEST_F(PublishedConditions, AreTakenFromTheirPublishedPlace) {
  const Json args = {{"image_cond_model", "dinov2_vits14_reg"}};
  const std::string missing = message(args);
  for (const char* part : {"/trainer/args/image_encoder", "ckpts/dinov2/dinov2_vits14_reg4_pretrain.pth", "patch"}) {
    EXPECT_NE(missing.find(part), std::string::npos) << missing;
  }
  // A file that is no archive of weights: its error shows that it was read.
  write_file_atomically("ckpts/dinov2/dinov2_vits14_reg4_pretrain.safetensors", "damaged");
  EXPECT_NE(message(args).find("dinov2_vits14_reg4_pretrain.safetensors"), std::string::npos) << message(args);
  write_file_atomically("ckpts/dinov2/dinov2_vits14_reg4_pretrain.pth", "damaged");
  EXPECT_NE(message(args).find("dinov2_vits14_reg4_pretrain.pth"), std::string::npos) << message(args);
  EXPECT_NE(message(args, 1024).find("image_cond_model"), std::string::npos) << "a width that does not fit";
  EXPECT_NE(message(Json::object()).find("dinov2_vitl14_reg4_pretrain.pth"), std::string::npos);
}

}  // namespace
}  // namespace anigen::features
