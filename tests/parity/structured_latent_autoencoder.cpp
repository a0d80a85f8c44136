// The structured-latent auto-encoder: both models in all variants, up to the mesh extraction, and the skin weights that
// the decoder gives to points.
#include <set>

#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

// The arguments of the class: keys that begin with '_' are about the fixture.
Json class_arguments(const Json& config) {
  Json arguments = Json::object();
  for (const auto& [key, value] : config.items()) {
    if (key.empty() || key[0] != '_') arguments[key] = value;
  }
  return arguments;
}

template <typename Model, typename Options>
Model filled_latent_coder(Fixture& fixture) {
  Model model(Options::from_json(class_arguments(fixture.config()), fixture.name() + ".json", "/config"),
              nn::Init::kNone);
  load_whole(model, fixture);
  return model;
}

sparse::SparseTensor sparse_input(const Fixture& fixture, const std::string& suffix) {
  const std::string feats = "feats" + suffix;
  return {sparse::Support::create(fixture.input("coords" + suffix)),
          fixture.has_input(feats) ? fixture.input(feats) : Tensor()};
}

// Checks what the fixture has of a list with one tensor per asset.
void check_list(Fixture& fixture, const std::set<std::string>& wanted, const std::string& name,
                const std::vector<Tensor>& list) {
  for (std::size_t i = 0; i < list.size(); ++i) {
    const std::string item = name + "." + std::to_string(i);
    if (wanted.count(item) > 0) fixture.check(item, list[i]);
  }
}

std::set<std::string> output_names(const Fixture& fixture) {
  const std::vector<std::string> names = fixture.outputs();
  return {names.begin(), names.end()};
}

void run_slat_encoder(Fixture& fixture) {
  auto model = filled_latent_coder<structured_latent::StructuredLatentEncoder,
                                   structured_latent::StructuredLatentEncoderOptions>(fixture);
  structured_latent::RiggedMeshes rigs;
  rigs.joints = fixture.inputs("joints");
  rigs.parents = fixture.inputs("parents");
  rigs.skin = fixture.inputs("skin");
  rigs.vertices = fixture.inputs("mesh_vertices");
  rigs.faces = fixture.inputs("mesh_faces");
  const sparse::SparseTensor x = sparse_input(fixture, ""), x_skl = sparse_input(fixture, "_skl");
  std::vector<Tensor> noise;
  for (const char* name : {"eps", "eps_skin", "eps_skl"}) {
    if (fixture.has_input(name)) noise.push_back(fixture.input(name));
  }
  const std::vector<Tensor> face = fixture.inputs("bvh_face_id"), places = fixture.inputs("bvh_uvw");
  const torch::NoGradGuard no_grad;
  std::vector<skin_field::VertexMix> lookups;
  for (std::size_t i = 0; i < face.size(); ++i)
    lookups.push_back(skin_field::surface_mix(face[i], places[i], rigs.faces[i]));
  if (lookups.empty()) lookups = model->skin_lookups(*x.support, rigs);
  const auto output = model->forward(x, x_skl, rigs, lookups, noise);
  fixture.check("z", output.z.feats);
  fixture.check("mean", output.mean);
  fixture.check("logvar", output.logvar);
  fixture.check("z_skl", output.z_skl.feats);
  fixture.check("mean_skl", output.mean_skl);
  fixture.check("logvar_skl", output.logvar_skl);
  fixture.check("x_skin", output.x_skin);
  fixture.check("x_skl", output.x_skl);
  const std::set<std::string> wanted = output_names(fixture);
  check_list(fixture, wanted, "joint_skin_embeds", output.joint_skin_embeds);
  check_list(fixture, wanted, "vert_skin_embeds", output.vert_skin_embeds);
  check_list(fixture, wanted, "joints_pos", output.joints_pos);
}

void check_skeleton_field(Fixture& fixture, const std::set<std::string>& wanted, const std::string& prefix,
                          const skeleton_field::SkeletonField& field,
                          const skeleton_field::JointSkinFeatures& features) {
  const std::pair<const char*, Tensor> parts[] = {{"joints", field.joints},
                                                  {"parents", field.parents},
                                                  {"positions", field.positions},
                                                  {"skin_feats", field.skin_features},
                                                  {"conf_j", field.conf_j},
                                                  {"conf_p", field.conf_p},
                                                  {"conf_skin", field.conf_skin},
                                                  {"skin_feats_joints", features.features},
                                                  {"skin_feats_joints_var_loss", features.variance}};
  for (const auto& [name, tensor] : parts) {
    if (wanted.count(prefix + name) == 0) continue;
    if (tensor.defined()) {
      fixture.check(prefix + name, tensor);
    } else {
      fixture.check_true(prefix + name + " exists", false);
    }
  }
}

void run_slat_decoder(Fixture& fixture) {
  auto model = filled_latent_coder<structured_latent::StructuredLatentDecoder,
                                   structured_latent::StructuredLatentDecoderOptions>(fixture);
  std::vector<skeleton_field::SkeletonTensors> given;
  const std::vector<Tensor> joints = fixture.inputs("gt_joints"), parents = fixture.inputs("gt_parents");
  for (std::size_t i = 0; i < joints.size(); ++i) given.push_back({joints[i], parents[i]});
  const torch::NoGradGuard no_grad;
  const auto decoded = model->forward(sparse_input(fixture, ""), sparse_input(fixture, "_skl"), given);
  const std::int64_t stride = fixture.config().value("_row_stride", std::int64_t{1});
  const auto stored_rows = [&](const Tensor& rows) { return rows.slice(0, 0, rows.size(0), stride); };
  fixture.check("mesh_coords", stored_rows(decoded.mesh.support->coords()));
  fixture.check("mesh_feats", stored_rows(decoded.mesh.feats));
  fixture.check("skl_coords", decoded.skeleton.support->coords());
  fixture.check("skl_feats", decoded.skeleton.feats);
  fixture.check("h_skin_coarse", decoded.skin_coarse);
  const std::set<std::string> wanted = output_names(fixture);
  for (std::size_t i = 0; i < decoded.skeletons.size(); ++i) {
    check_skeleton_field(fixture, wanted, "skl." + std::to_string(i) + ".", decoded.skeletons[i],
                         decoded.joint_features[i]);
  }
  const std::vector<Tensor> points = fixture.inputs("vertex_skin_feats");
  std::vector<Tensor> skin;
  for (std::size_t i = 0; i < points.size(); ++i) {
    // A limit that only a few points fit into, so that there are several chunks.
    skin.push_back(model->skin_weights(points[i], decoded.joints[i], decoded.joint_features[i].features, 1 << 14));
  }
  check_list(fixture, wanted, "skin_pred", skin);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(slat_encoder, anigen::test::run_slat_encoder)
ANIGEN_DEVICE_PARITY(slat_decoder, anigen::test::run_slat_decoder)
