// Complete inference from a folder of published checkpoints: both flows, both decoders, the mesh, and the encoders.
// The comparison covers what anigen-generate computes; only the image's tokens and the noise are the fixture's.
#include <algorithm>

#include "anigen/generate/asset_generator.h"
#include "anigen/generate/run_weights.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/structured_latent/decoder.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

fs::path runs_of(const Fixture& fixture) {
  return fixture.folder() / fixture.json().at("checkpoint_root").get<std::string>() / "ckpts" / "anigen";
}

flow::SamplerOptions sampler(const Json& steps, const Json& strength) {
  flow::SamplerOptions options;
  options.steps = steps.get<std::int64_t>();
  options.cfg_strength = strength.get<double>();
  return options;
}

Tensor voxels_of(const Tensor& occupied) {
  const Tensor places = torch::nonzero(occupied).to(torch::kInt32);
  return torch::cat({torch::zeros({places.size(0), 1}, torch::kInt32), places}, 1);
}

flow::Streams sampled_structure(Fixture& fixture, generate::StructureGenerator& generator, const Json& settings) {
  return generator.sample({fixture.input("noise_ss"), fixture.input("noise_ss_skl")}, fixture.input("cond_ss"),
                          sampler(settings.at("ss_steps"), settings.at("cfg_scale_ss")), /*guided=*/true);
}

void check_structure(Fixture& fixture, const fs::path& runs) {
  generate::StructureGenerator::Request request;
  request.run = runs / "ss_flow_solo";
  generate::StructureGenerator generator(request);
  const flow::Streams latents = sampled_structure(fixture, generator, fixture.config());
  fixture.check("z_s", latents[0]);
  fixture.check("z_s_skl", latents[1]);
  const auto logits = generator.logits(latents, 0);
  fixture.check("ss_logits", logits.shape);
  fixture.check("ss_logits_skl", logits.skeleton);
  const sparse_structure::VoxelPair voxels = generator.decode(latents).front();
  fixture.check("coords", voxels_of(voxels.shape));
  fixture.check("coords_skl", voxels_of(voxels.skeleton));

  request.averages = nn::Averages::kAlways;
  generate::StructureGenerator averaged(request);
  const flow::Streams others = sampled_structure(fixture, averaged, fixture.config().at("ema"));
  fixture.check("ema.z_s", others[0]);
  fixture.check("ema.z_s_skl", others[1]);
}

structured_latent::PerStream<sparse::SparseTensor> check_latents(Fixture& fixture, const fs::path& runs) {
  generate::FlowRequest request;
  request.run = runs / "slat_flow_control";
  generate::StructuredLatentGenerator generator(request);
  const Json& config = fixture.config();
  structured_latent::StructuredLatentTarget target;
  target.shape = sparse::Support::create(fixture.expected("coords"));
  target.skeleton = sparse::Support::create(fixture.expected("coords_skl"));
  target.tokens = fixture.input("cond_slat");
  target.joints_num = torch::tensor({config.at("joints_num").get<std::int64_t>()});
  fixture.check_true("joints of the level",
                     generate::joints_of_level(config.at("joints_density").get<int>()) == config.at("joints_num"));
  auto latents = generator.sample({fixture.input("noise_slat"), fixture.input("noise_slat_skl")}, target,
                                  sampler(config.at("slat_steps"), config.at("cfg_scale_slat")), /*guided=*/true);
  fixture.check("slat", torch::cat({latents.geometry.feats, latents.skin.feats}, 1));
  fixture.check("slat_skl", latents.skeleton.feats);
  return latents;
}

// A quad whose two diagonals are equally good but for rounding may be cut along the other one: both triangles then
// hold the same four vertices.
Tensor with_given_diagonals(const Tensor& faces, const Tensor& wanted, std::int64_t most) {
  if (faces.sizes() != wanted.sizes()) return faces;
  Tensor result = faces.clone();
  const auto row_set = [](const Tensor& rows) {
    const Tensor flat = rows.reshape(-1).to(torch::kInt64).contiguous();
    std::vector<std::int64_t> ids(flat.data_ptr<std::int64_t>(), flat.data_ptr<std::int64_t>() + flat.numel());
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    return ids;
  };
  for (std::int64_t f = 0; f + 1 < faces.size(0) && most > 0; ++f) {
    if (torch::equal(faces[f], wanted[f])) continue;
    const std::vector<std::int64_t> mine = row_set(faces.slice(0, f, f + 2));
    if (mine.size() != 4 || mine != row_set(wanted.slice(0, f, f + 2))) continue;
    result.slice(0, f, f + 2).copy_(wanted.slice(0, f, f + 2));
    --most;
    ++f;
  }
  return result;
}

void check_decoding(Fixture& fixture, const fs::path& runs,
                    const structured_latent::PerStream<sparse::SparseTensor>& latents) {
  const nn::RunModel found =
      nn::find_run_model(runs / "slat_dae", structured_latent::kStructuredLatentDecoderClass, "final");
  structured_latent::StructuredLatentDecoder decoder = structured_latent::load_rig_decoder(found, torch::kCPU);
  const auto decoded = decoder->forward(latents);
  const Tensor rows = fixture.input("mesh_rows");
  fixture.check("mesh_coords_rows", decoded.mesh.support->coords().index_select(0, rows));
  fixture.check("mesh_feats_rows", decoded.mesh.feats.index_select(0, rows));
  fixture.check("mesh_feats_sum", decoded.mesh.feats.sum(0));
  const skeleton_field::SkeletonField& votes = decoded.skeletons.front();
  fixture.check("joint_votes", votes.joints);
  fixture.check("parent_votes", votes.parents);
  fixture.check("conf_j", votes.conf_j);
  fixture.check("conf_p", votes.conf_p);
  const skeleton_field::SkeletonTensors& skeleton = decoded.joints.front();
  fixture.check("joints", skeleton.joints);
  fixture.check("parents", skeleton.parents);
  fixture.check("joint_skin_feats", decoded.joint_features.front().features);
  const shape_field::ExtractedMesh mesh = decoder->extract_meshes(decoded, /*training=*/false).front();
  constexpr std::int64_t kOtherDiagonals = 4;
  fixture.check("vertices", mesh.vertices);
  fixture.check("faces",
                with_given_diagonals(mesh.faces.to(torch::kInt32), fixture.expected("faces"), kOtherDiagonals));
  fixture.check("vertex_attrs", mesh.attributes);
  fixture.check("vertex_skin_feats", mesh.skin_features);
  fixture.check("skin_weights",
                decoder->skin_weights(mesh.skin_features, skeleton, decoded.joint_features.front().features));
}

void check_encoders(Fixture& fixture, const fs::path& runs) {
  auto structure = nn::load_trained<sparse_structure::SparseStructureEncoder>(
      nn::find_run_model(runs / "ss_dae", sparse_structure::kSparseStructureEncoderClass, "final"), torch::kCPU);
  const auto dense = structure->forward(fixture.input("enc.occ"), fixture.input("enc.occ_skl"));
  fixture.check("enc.z_ss", dense.z);
  fixture.check("enc.z_ss_skl", dense.z_skl);

  auto encoder = nn::load_trained<structured_latent::StructuredLatentEncoder>(
      nn::find_run_model(runs / "slat_dae", structured_latent::kStructuredLatentEncoderClass, "final"), torch::kCPU);
  structured_latent::RiggedMeshes rig;
  rig.joints = {fixture.input("enc.joints")};
  rig.parents = {fixture.input("enc.parents")};
  rig.skin = {fixture.input("enc.skin")};
  rig.vertices = {fixture.input("enc.mesh_vertices")};
  const sparse::SparseTensor x{sparse::Support::create(fixture.input("enc.coords")), fixture.input("enc.feats")};
  const sparse::SparseTensor x_skl{sparse::Support::create(fixture.input("enc.coords_skl")), Tensor()};
  const auto latents = encoder->forward(x, x_skl, rig);
  fixture.check("enc.slat", latents.z.feats);
  fixture.check("enc.slat_skl", latents.z_skl.feats);
}

void run_e2e(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const fs::path runs = runs_of(fixture);
  check_structure(fixture, runs);
  check_decoding(fixture, runs, check_latents(fixture, runs));
  check_encoders(fixture, runs);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(e2e, anigen::test::run_e2e)
