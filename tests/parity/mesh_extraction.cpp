// From the channels of fine voxels to a mesh: evaluation, training with regulariser and gradient, and the alternative
// interpolations of vertex features.
#include "anigen/shape_field/mesh_extraction.h"

#include <string>
#include <utility>

#include "anigen/core/config.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

shape_field::MeshFieldOptions mesh_options(const Fixture& fixture, const Json& switches, const std::string& pointer) {
  using Options = shape_field::MeshFieldOptions;
  static const std::pair<const char*, bool Options::*> kSwitches[] = {
      {"flexicube_disable_deform", &Options::disable_deform},
      {"vertex_skin_feat_interp_sparse", &Options::skin_interp_sparse},
      {"vertex_skin_feat_interp_nearest", &Options::skin_interp_nearest},
      {"vertex_skin_feat_interp_trilinear", &Options::skin_interp_trilinear},
      {"vertex_skin_feat_interp_use_deformed_grid", &Options::skin_interp_use_deformed_grid},
      {"vertex_skin_feat_nodeform_trilinear", &Options::skin_nodeform_trilinear}};
  const Json& config = fixture.config();
  Options options;
  options.resolution = config.at("res");
  options.use_color = config.at("use_color");
  options.skin_channels = 0;
  if (config.value("predict_skin", true)) options.skin_channels = config.at("skin_feat_channels");
  ConfigReader reader(switches, fixture.name() + ".json", pointer);
  for (const auto& [name, member] : kSwitches) options.*member = reader.boolean(name, options.*member);
  reader.finish();
  return options;
}

shape_field::ExtractedMesh extracted(const Fixture& fixture, const Tensor& feats,
                                     const shape_field::MeshFieldOptions& options, bool training) {
  return shape_field::extract_mesh(fixture.input("coords").narrow(1, 1, 3), feats, options, training);
}

// Area and unit normal of every face. The normals of slivers are noise: those are not compared.
void check_faces(Fixture& fixture, const shape_field::ExtractedMesh& mesh) {
  const auto corner = [&](std::int64_t k) { return mesh.vertices.detach().index_select(0, mesh.faces.select(1, k)); };
  const Tensor normal = torch::cross(corner(1) - corner(0), corner(2) - corner(0), 1).to(torch::kCPU);
  const Tensor length = normal.norm(2, 1, /*keepdim=*/true);
  fixture.check("face_area", 0.5 * length.squeeze(1));
  const Tensor compared = fixture.expected("face_area").gt(1e-5).unsqueeze(1), wanted = fixture.expected("face_normal");
  const bool same_faces = wanted.size(0) == normal.size(0);
  fixture.check("face_normal", same_faces ? torch::where(compared, normal / length, wanted) : normal / length);
}

void check_training(Fixture& fixture, const shape_field::ExtractedMesh& mesh, const Tensor& feats) {
  fixture.check("reg_loss", mesh.regularizer);
  fixture.check("L_dev_mean", mesh.terms.deviation);
  fixture.check("weights_abs_mean", mesh.terms.weights);
  fixture.check("consistency_loss", mesh.terms.consistency);
  fixture.check("tsdf_v", mesh.field.positions());
  fixture.check("tsdf_s", mesh.field.sdf);
  // S of the fixture's description; means over nothing are left out.
  const auto mean = [&](const Tensor& x) {
    return x.defined() && x.numel() > 0 ? x.mean() : torch::zeros({}, feats.device());
  };
  const auto mean_square = [&](const Tensor& x) { return x.defined() ? mean(x.square()) : torch::zeros({}); };
  const Tensor tilt = nn::to_device(torch::tensor({0.3f, -0.7f, 1.1f}), feats.device());
  const Tensor sum = 10.0 * mesh.regularizer + mean(mesh.vertices.square().sum(1)) + mean(mesh.vertices * tilt) +
                     mean_square(mesh.field.sdf) + mean_square(mesh.attributes) + mean_square(mesh.skin_features);
  fixture.check("S", sum);
  sum.backward();
  fixture.check("grad.feats", feats.grad());
}

void run_mesh(Fixture& fixture) {
  const bool training = fixture.config().at("training");
  const shape_field::MeshFieldOptions options =
      mesh_options(fixture, fixture.config().at("options"), "/config/options");
  const Tensor feats = fixture.input("feats").requires_grad_(training);
  const shape_field::ExtractedMesh mesh = extracted(fixture, feats, options, training);
  fixture.check("success", torch::tensor({mesh.success ? 1 : 0}, torch::kInt32));
  fixture.check("vertices", mesh.vertices);
  fixture.check("faces", mesh.faces);
  check_faces(fixture, mesh);
  if (options.use_color) fixture.check("vertex_attrs", mesh.attributes);
  fixture.check("grid_positions", mesh.field.grid_positions());
  if (options.skin_channels > 0) {
    fixture.check("vertex_skin_feats", mesh.skin_features);
    fixture.check("grid_skin_feats", mesh.field.attributes.narrow(1, 0, options.skin_channels));
  }
  if (training) check_training(fixture, mesh, feats);
}

void run_mesh_skin_options(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  for (const auto& [name, switches] : fixture.config().at("cases").items()) {
    const shape_field::MeshFieldOptions options = mesh_options(fixture, switches, "/config/cases/" + name);
    const shape_field::ExtractedMesh mesh = extracted(fixture, fixture.input("feats"), options, /*training=*/false);
    for (const std::string& output : fixture.outputs()) {
      if (output == name + ".vertices") fixture.check(output, mesh.vertices);
      if (output == name + ".faces") fixture.check(output, mesh.faces);
      if (output == name + ".vertex_attrs") fixture.check(output, mesh.attributes);
      if (output == name + ".vertex_skin_feats") fixture.check(output, mesh.skin_features);
    }
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(mesh_blobs_eval, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_blobs_train, anigen::test::run_mesh)
ANIGEN_PARITY(mesh_empty, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_nocolor_eval, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_noise_eval, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_sphere_eval, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_sphere_train, anigen::test::run_mesh)
ANIGEN_DEVICE_PARITY(mesh_skin_options, anigen::test::run_mesh_skin_options)
