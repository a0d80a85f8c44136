// Choice of the file of a checkpoint folder, and the models' results with it.
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

namespace fs = std::filesystem;

// "<folder>.regular" and "<folder>.ema" are flow models, "<folder>" is a decoder named "final".
fs::path choose(const fs::path& root, const std::string& name) {
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) return io::choose_checkpoint(root / name, "decoder", "final");
  return io::choose_flow_checkpoint(root / name.substr(0, dot), name.substr(dot + 1) == "ema");
}

bool readable(const fs::path& file) {
  const io::NamedArrays arrays = io::read_state_dict(file);
  for (const auto& [key, array] : arrays) {
    if (key.compare(0, 7, "module.") == 0) return false;
    if (!torch::isfinite(nn::to_tensor(array).to(torch::kFloat32)).all().item<bool>()) return false;
  }
  return !arrays.empty();
}

// The model that the folder's config.json describes, loaded as inference does: keys that one side lacks are left alone.
template <typename Model, typename Options>
Model build(const fs::path& folder, const std::string& model_key, const fs::path& weights) {
  const fs::path config = folder / "config.json";
  const Json arguments = read_json(config).at("models").at(model_key).at("args");
  Model model(Options::from_json(arguments, config.string(), "/models/" + model_key + "/args"));
  nn::load_state_dict(*model, io::read_state_dict(weights), nn::LoadMode::kNonStrict, weights.string());
  return model;
}

void check_outputs(Fixture& fixture, const std::string& name, const fs::path& folder, const fs::path& weights) {
  const torch::NoGradGuard no_grad;
  if (name.find('.') == std::string::npos) {
    auto decoder = build<sparse_structure::SparseStructureDecoder, sparse_structure::SparseStructureDecoderOptions>(
        folder, "decoder", weights);
    const auto logits = decoder->forward(fixture.input("z"), fixture.input("z_skl"));
    fixture.check(name + ".occ", logits.shape);
    fixture.check(name + ".occ_skl", logits.skeleton);
    return;
  }
  auto denoiser = build<sparse_structure::SparseStructureFlow, sparse_structure::SparseStructureFlowOptions>(
      folder, "denoiser", weights);
  const auto velocity =
      denoiser->forward(fixture.input("x"), fixture.input("x_skl"), fixture.input("t"), fixture.input("cond"));
  fixture.check(name + ".v", velocity.shape);
  fixture.check(name + ".v_skl", velocity.skeleton);
}

void run_ckpt_selection(Fixture& fixture) {
  const fs::path root = fixture.folder() / fixture.name();
  for (const auto& [name, expected] : fixture.config().at("expected_file").items()) {
    const fs::path file = choose(root, name);
    fixture.check_true(name + " reads " + file.filename().string() + ", expected " + expected.get<std::string>(),
                       file.filename() == expected.get<std::string>());
    fixture.check_true(name + ": finite tensors without the prefix module.", readable(file));
    check_outputs(fixture, name, root / name.substr(0, name.find('.')), file);
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ckpt_selection, anigen::test::run_ckpt_selection)
