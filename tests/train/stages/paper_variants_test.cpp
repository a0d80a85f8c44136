#include "anigen/train/stages/paper_variants.h"

#include <gtest/gtest.h>

#include <map>
#include <string>

#include "anigen/core/config.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

Json shipped_config(const std::string& name) { return load_config(test::source_dir() / "configs" / (name + ".json")); }

using Added = std::map<std::string, Json>;  // by JSON pointer

// Arguments that "paper" adds to a config.
Added added_by_paper(Json config) {
  config["trainer"]["args"]["compatibility"] = "paper";
  const Json before = config;
  fill_in_paper_variants(config);
  Added added;
  for (const Json& change : Json::diff(before, config)) {
    EXPECT_EQ(change.at("op"), "add") << change.dump();
    added[change.at("path").get<std::string>()] = change.at("value");
  }
  return added;
}

TEST(PaperVariants, PublishedConfigsStayAsTheyAre) {
  for (const char* name : {"published/ss_dae", "published/slat_dae", "published/anigen_skin_ae", "tiny/skin_ae",
                           "anymate/conn", "anymate/conn_token"}) {
    for (const bool said : {false, true}) {
      Json config = shipped_config(name);
      if (said && std::string(name) != "tiny/skin_ae") config["trainer"]["args"]["compatibility"] = "published";
      const Json before = config;
      fill_in_paper_variants(config);
      EXPECT_EQ(config, before) << name;
    }
  }
}

TEST(PaperVariants, FillInWhatAConfigDoesNotSay) {
  // Published configs say nearly all of it, and freeze the shape.
  EXPECT_EQ(added_by_paper(shipped_config("published/ss_dae")),
            Added({{"/models/encoder/args/normalize_norm", "l1"}, {"/models/decoder/args/normalize_norm", "l1"}}));
  EXPECT_EQ(added_by_paper(shipped_config("published/slat_dae")), Added());
  EXPECT_EQ(added_by_paper(shipped_config("published/anigen_skin_ae")), Added());

  Json bare = {
      {"models",
       {{"encoder", {{"name", "E"}, {"args", {{"use_pretrain_branch", false}}}}}, {"decoder", {{"name", "D"}}}}},
      {"trainer", {{"name", "AniGenSparseStructureVaeTrainer"}, {"args", {{"max_steps", 50}}}}}};
  EXPECT_EQ(added_by_paper(bare), Added({{"/models/decoder/args", {{"normalize_norm", "l1"}}},
                                         {"/models/encoder/args/latent_denoising", true},
                                         {"/models/encoder/args/normalize_norm", "l1"},
                                         {"/models/encoder/args/normalize_z", true},
                                         {"/trainer/args/latent_achive_max_step", 50},
                                         {"/trainer/args/latent_achive_max_step_skl", 50},
                                         {"/trainer/args/latent_denoising", true},
                                         {"/trainer/args/latent_denoising_skl", true},
                                         {"/trainer/args/latent_time_max", 0.75},
                                         {"/trainer/args/latent_time_max_skl", 0.75}}));
  bare["trainer"]["name"] = "AniGenSLatVaeSkeletonTrainer";
  EXPECT_EQ(added_by_paper(bare), Added({{"/trainer/args/geometry_latent", "dae"},
                                         {"/trainer/args/latent_achive_max_step", 50},
                                         {"/trainer/args/latent_achive_max_step_skl", 50},
                                         {"/trainer/args/latent_denoising", true},
                                         {"/trainer/args/latent_denoising_skl", true},
                                         {"/trainer/args/latent_time_max", 0.75},
                                         {"/trainer/args/latent_time_max_skl", 0.75}}));
  for (const char* name : {"anymate/conn", "anymate/conn_token"}) {
    EXPECT_EQ(added_by_paper(shipped_config(name)),
              Added({{"/models/model/args/children", "columns"}, {"/trainer/args/connectivity_loss", "bce"}}));
  }
  EXPECT_EQ(added_by_paper(shipped_config("anymate/joints")), Added());
}

// configs/paper says what published configs contradict: nothing is left to fill in, and the skin's latent has the
// text's 4 channels in both models of stage 3 and in the flow.
TEST(PaperVariants, ShippedOnesAreComplete) {
  for (const char* name : {"paper/skin_ae", "paper/ss_dae", "paper/slat_dae", "paper/slat_flow"}) {
    Json config = shipped_config(name);
    const Json before = config;
    fill_in_paper_variants(config);
    EXPECT_EQ(config, before) << name;
  }
  const Json stage3 = shipped_config("paper/slat_dae"), flow = shipped_config("paper/slat_flow");
  for (const char* model : {"encoder", "decoder"})
    EXPECT_EQ(stage3["models"][model]["args"]["latent_channels_vertskin"], 4);
  EXPECT_EQ(flow["models"]["denoiser"]["args"]["in_channels_vert_skin"], 4);
  EXPECT_EQ(flow["models"]["denoiser"]["args"]["out_channels_vert_skin"], 4);
  EXPECT_EQ(shipped_config("published/slat_dae")["models"]["encoder"]["args"]["latent_channels_vertskin"], 8);
}

TEST(PaperVariants, WhatIsNoConfigIsLeftToItsReaders) {
  for (const char* text : {"[]", "3", "{}", R"({"trainer": 3})", R"({"trainer": {"args": {"compatibility": 5}}})",
                           R"({"trainer": {"name": 7, "args": {"compatibility": "paper"}}})",
                           R"({"models": [], "trainer": {"name": "AniGenSparseStructureVaeTrainer",
                               "args": {"compatibility": "paper"}}})",
                           R"({"models": {"encoder": {"args": 3}, "decoder": {"args": 4}},
                               "trainer": {"name": "AniGenSLatVaeSkeletonTrainer",
                               "args": {"compatibility": "paper"}}})"}) {
    Json config = Json::parse(text);
    const Json before = config;
    fill_in_paper_variants(config);
    EXPECT_EQ(config, before) << text;
  }
}

}  // namespace
}  // namespace anigen::train
