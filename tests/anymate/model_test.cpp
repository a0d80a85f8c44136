#include <gtest/gtest.h>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/model.h"
#include "anigen/anymate/volumes.h"
#include "anigen/core/error.h"
#include "anigen/nn/state_dict.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::anymate {

namespace {

// A chain of joints with one bone between each pair, and as many points as bones, each held by one of them.
AnymateSample chain_sample(std::int64_t joints, std::int64_t points = 4) {
  AnymateSample sample;
  sample.name = "chain" + std::to_string(joints);
  sample.joints = torch::rand({joints, 3});
  sample.conns = torch::arange(-1, joints - 1).clamp_min(0).to(torch::kInt8);
  sample.bones = torch::cat({sample.joints.slice(0, 0, joints - 1), sample.joints.slice(0, 1)}, 1);
  sample.points_cloud = torch::rand({points, 6});
  sample.skins_index =
      torch::stack({torch::arange(points).remainder(joints - 1), torch::full({points}, -1)}, 1).to(torch::kInt8);
  sample.skins_weight = torch::tensor({0.75F, 0.0F}).expand({points, 2}).to(torch::kHalf);
  sample.vox = torch::randint(64, {joints, 3}, torch::kInt8);
  return sample;
}

TEST(AnymateCollate, PadsMasksAndMakesDense) {
  const std::vector<AnymateSample> samples = {chain_sample(3), chain_sample(5)};
  const AnymateBatch batch = collate(samples);
  EXPECT_EQ(batch.joints_num, (std::vector<std::int64_t>{3, 5}));
  EXPECT_EQ(batch.joints.sizes(), (std::vector<std::int64_t>{2, 96, 3}));
  EXPECT_TRUE(torch::equal(batch.joints[0].narrow(0, 0, 3), samples[0].joints));
  EXPECT_TRUE((batch.joints[0].slice(0, 3) == -3).all().item<bool>());
  EXPECT_TRUE((batch.bones[1].slice(0, 4) == -3).all().item<bool>());
  EXPECT_EQ(batch.joints_mask.sizes(), (std::vector<std::int64_t>{2, 5}));
  EXPECT_EQ(batch.joints_mask.sum(1).select(0, 0).item<std::int64_t>(), 3);
  EXPECT_EQ(batch.bones_mask.sum().item<std::int64_t>(), 2 + 4);
  // Rows are children: the root is its own parent, the others have the joint before.
  EXPECT_EQ(batch.conns.sizes(), (std::vector<std::int64_t>{2, 96, 5}));
  EXPECT_EQ(batch.conns.sum().item<double>(), 8.0);
  EXPECT_EQ(batch.conns[1][0][0].item<double>(), 1.0);
  EXPECT_EQ(batch.conns[1][4][3].item<double>(), 1.0);
  // Point 1 of the chain of three belongs to bone 1.
  EXPECT_EQ(batch.skins.sizes(), (std::vector<std::int64_t>{2, 4, 4}));
  EXPECT_EQ(batch.skins.scalar_type(), torch::kFloat64);
  EXPECT_EQ(batch.skins[0][1][1].item<double>(), 0.75);
  EXPECT_EQ(batch.skins.sum().item<double>(), 0.75 * 8);
  EXPECT_EQ(batch.vox.size(), 2U);
}

TEST(AnymateCollate, DiffusionRepeatsJointsInTurn) {
  const std::vector<AnymateSample> samples = {chain_sample(3), chain_sample(9)};
  const AnymateBatch batch = collate_diffusion(samples, 7);
  EXPECT_EQ(batch.joints_repeat.sizes(), (std::vector<std::int64_t>{2, 7, 3}));
  EXPECT_TRUE(torch::equal(batch.joints_repeat[0][6], samples[0].joints[0]));
  EXPECT_TRUE(torch::equal(batch.joints_repeat[1], samples[1].joints.narrow(0, 0, 7)));
  EXPECT_FALSE(batch.conns.defined());
  EXPECT_THROW(collate_diffusion(samples, 0), InputError);
}

TEST(AnymateCollate, LeavesOutWhatNoSampleHas) {
  AnymateSample sample = chain_sample(3);
  sample.skins_index = sample.conns = sample.vox = Tensor();
  const AnymateBatch batch = collate({sample});
  EXPECT_FALSE(batch.skins.defined() || batch.conns.defined());
  EXPECT_TRUE(batch.vox.empty());
  EXPECT_THROW(collate({sample, chain_sample(3)}), InputError);
}

TEST(AnymateCollate, NamesTheSampleThatIsWrong) {
  const auto with = [](auto change) {
    AnymateSample sample = chain_sample(4);
    change(sample);
    return std::vector<AnymateSample>{chain_sample(3), sample};
  };
  EXPECT_THROW(collate({}), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.conns[2] = 4; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.conns = s.conns.slice(0, 1); })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_index[0][1] = 3; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_index[0][1] = -2; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_weight = Tensor(); })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.points_cloud = s.points_cloud.slice(0, 1); })), InputError);
  EXPECT_THROW(collate({chain_sample(97)}), InputError);
  try {
    collate(with([](AnymateSample& s) { s.bones = Tensor(); }));
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "chain4/bones");
  }
}

}  // namespace

namespace {

std::int64_t parameter_count(const torch::nn::Module& module) {
  std::int64_t count = 0;
  for (const Tensor& parameter : module.parameters()) count += parameter.numel();
  return count;
}

struct ReleasedSize {
  const char* decoder;
  std::int64_t parameters;
  std::size_t tensors;  // of the state dict
};

// docs/reference/anymate.md, 3, 4, 5 and 2. Memory is reserved and not touched.
TEST(AnymateModel, DecodersHaveTheReleasedSizes) {
  for (const ReleasedSize& size : std::vector<ReleasedSize>{{"transformer_latent", 7164675, 19},
                                                            {"Pointe_Diffusion", 89785347, 156},
                                                            {"Cross_Attention_Diffusion", 171034883, 439},
                                                            {"implicit_transformer", 7129345, 20},
                                                            {"triplane", 31619118, 136},
                                                            {"attendjoints_con_token", 31209472, 68},
                                                            {"attendjoints_con_combine", 43740672, 82},
                                                            {"attendjoints_multi", 29664000, 56},
                                                            {"attendjoints_combine", 29671680, 70}}) {
    const auto decoder = make_decoder(ModelOptions::released("bert", size.decoder), nn::Init::kNone);
    EXPECT_EQ(parameter_count(*decoder), size.parameters) << size.decoder;
    EXPECT_EQ(nn::state_entries(*decoder).size(), size.tensors) << size.decoder;
  }
}

TEST(AnymateModel, EncodersHaveTheReleasedSizes) {
  const PointBert bert(PointBertOptions{}, nn::Init::kNone);
  EXPECT_EQ(parameter_count(*bert), 21859200);
  EXPECT_EQ(nn::state_entries(*bert).size(), 160U);
  EXPECT_EQ(parameter_count(*TokenProjection(ProjectionWidths{})), 853760);
  const ScratchEncoder scratch(ScratchEncoderOptions{}, nn::Init::kNone);
  EXPECT_EQ(nn::state_entries(*scratch).size(), 115U);
}

TEST(AnymateModel, ReleasedModelsHaveTheReleasedSizes) {
  for (const auto& [decoder, parameters] :
       std::vector<std::pair<std::string, std::int64_t>>{{"transformer_latent", 29877635},
                                                         {"attendjoints_con_combine", 66453632},
                                                         {"attendjoints_combine", 52384640}}) {
    const ModelOptions options = ModelOptions::from_checkpoint_name("bert-" + decoder + "-train-8gpu-finetune.pth.tar");
    EXPECT_EQ(parameter_count(*AnymateModel(options, nn::Init::kNone)), parameters) << decoder;
  }
}

TEST(AnymateModel, KeysAreThoseOfCheckpoints) {
  const auto has_key = [](const torch::nn::Module& model, const std::string& key) {
    for (const nn::StateEntry& entry : nn::state_entries(model)) {
      if (entry.key == key) return true;
    }
    return false;
  };
  const AnymateModel bert(ModelOptions::released("bert", "transformer_latent"), nn::Init::kNone);
  for (const char* key : {"encoder.cls_pos", "encoder.encoder.first_conv.1.num_batches_tracked",
                          "encoder.blocks.blocks.11.attn.qkv.weight", "point_proj.4.weight", "decoder.query",
                          "decoder.cross_attn_decoder.attn.c_kv.weight"}) {
    EXPECT_TRUE(has_key(*bert, key)) << key;
  }
  EXPECT_FALSE(has_key(*bert, "encoder.blocks.blocks.0.attn.qkv.bias"));
  const AnymateModel pooled(ModelOptions::released("bert", "triplane"), nn::Init::kNone);
  EXPECT_TRUE(has_key(*pooled, "point_proj.0.4.weight"));
  EXPECT_TRUE(has_key(*pooled, "point_proj.1.weight"));
  const AnymateModel miche(ModelOptions::released("miche", "attendjoints_combine"), nn::Init::kNone);
  EXPECT_TRUE(has_key(*miche, "encoder.shape_projection"));
  EXPECT_TRUE(has_key(*miche, "encoder.transformer.resblocks.15.mlp.c_proj.bias"));
  const AnymateModel scratch(ModelOptions::released("transformer", "Cross_Attention_Diffusion"), nn::Init::kNone);
  EXPECT_TRUE(has_key(*scratch, "encoder.encoder.self_attn.resblocks.7.attn.c_qkv.bias"));
  EXPECT_TRUE(has_key(*scratch, "points_cloud_embed.weight"));
}

// The output of a decoder for some input, as a scalar.
Tensor some_loss(AnymateModelImpl& model, const Tensor& latents) {
  const Tensor joints = torch::rand({2, 7, 3}) * 2.0 - 1.0;
  switch (model.options().decoder) {
    case DecoderKind::kJointRegression:
      return joint_chamfer_loss(model.decoder<JointRegressionImpl>().forward(latents), joints, {7, 4});
    case DecoderKind::kConcatDenoiser:
    case DecoderKind::kCrossDenoiser:
      return denoising_term(model.decoder<JointDenoiserImpl>(), DdimSchedule(), joints, latents).loss;
    case DecoderKind::kImplicitVolume:
    case DecoderKind::kTriplaneVolume:
      return joint_volume_loss(model.decoder<JointVolumeImpl>(), latents,
                               {torch::randint(64, {30, 3}, torch::kInt64), torch::randint(64, {20, 3}, torch::kInt64)},
                               {joints[0], joints[1]});
    case DecoderKind::kTokenConnectivity:
    case DecoderKind::kTwoBranchConnectivity: {
      const Tensor logits = model.decoder<ConnectivityImpl>().forward(latents, joints);
      return connectivity_loss(logits, torch::eye(7).expand({2, 7, 7}));
    }
    case DecoderKind::kConcatSkinning:
    case DecoderKind::kCrossSkinning: {
      const SkinningInput input = {latents, small_cloud(2, 16), torch::rand({2, 5, 6}), {}};
      return skinning_losses(model.decoder<SkinningImpl>().forward(input), torch::rand({2, 16, 5})).cos_clamp;
    }
  }
  return {};
}

// In evaluation, where nothing is dropped, so that each parameter takes part.
TEST(AnymateModel, GradientsReachEveryParameterOfEveryPair) {
  torch::manual_seed(1);
  for (const std::string& encoder : encoder_names()) {
    for (const std::string& decoder : decoder_names()) {
      if (encoder == "transformer" && decoder == "triplane") continue;
      SCOPED_TRACE(encoder + " " + decoder);
      AnymateModel model(small_model(encoder, decoder));
      model->eval();
      {
        // Layers that start at zero let nothing through.
        const torch::NoGradGuard no_grad;
        for (Tensor parameter : model->parameters()) {
          if (parameter.count_nonzero().item<std::int64_t>() == 0) parameter.normal_(0.0, 0.1);
        }
      }
      AnymateModelImpl::EncoderDraws draws;
      if (encoder == "miche") draws.posterior_noise = torch::randn({2, 5, 4});
      const Tensor loss = some_loss(*model, model->encode(small_cloud(2, 40), draws));
      ASSERT_TRUE(std::isfinite(loss.item<double>()));
      loss.backward();
      for (const auto& parameter : model->named_parameters()) {
        const Tensor gradient = parameter.value().grad();
        ASSERT_TRUE(gradient.defined()) << parameter.key();
        EXPECT_TRUE(gradient.isfinite().all().item<bool>()) << parameter.key();
      }
    }
  }
}

TEST(AnymateModel, RefusesWhatDoesNotFit) {
  EXPECT_THROW(ModelOptions::released("bert", "attendjoints_combin"), InputError);
  EXPECT_THROW(ModelOptions::released("clip", "triplane"), InputError);
  EXPECT_THROW(ModelOptions::from_checkpoint_name("model.pth"), InputError);
  EXPECT_THROW(AnymateModel(small_model("transformer", "triplane")), InputError);
  ModelOptions wide = small_model("bert", "transformer_latent");
  wide.head.width = 48;
  EXPECT_THROW(AnymateModel{wide}, InputError);
  ModelOptions odd = small_model("bert", "attendjoints_multi");
  odd.head.heads = 5;
  EXPECT_THROW(make_decoder(odd), InputError);
  AnymateModel model(small_model("bert", "transformer_latent"));
  EXPECT_THROW(model->decoder<CrossSkinningImpl>(), InputError);
  EXPECT_THROW(model->encode(torch::zeros({1, 4, 6})), InputError);  // fewer points than groups
  EXPECT_THROW(model->decoder<JointRegressionImpl>().forward(torch::zeros({1, 3, 7})), InputError);
}

TEST(AnymateModel, OptionsComeFromAConfig) {
  const ModelOptions options = ModelOptions::from_json(
      Json::parse(R"({"encoder": "miche", "decoder": "Cross_Attention_Diffusion", "num_joints": 96, "width": 768,
                      "heads": 12, "flash": false, "num_train_step": 100, "num_training_points": 128,
                      "num_blocks": 2})"),
      "config.json", "/model");
  EXPECT_EQ(options.encoder, EncoderKind::kMichelangelo);
  EXPECT_EQ(options.cross_denoiser.num_blocks, 2);
  EXPECT_THROW(ModelOptions::from_json(Json::parse(R"({"encoder": "bert", "decoder": "triplane", "widht": 768})")),
               InputError);
  EXPECT_THROW(ModelOptions::from_json(Json::parse(R"({"encoder": "bert"})")), InputError);
}

}  // namespace

}  // namespace anigen::anymate
