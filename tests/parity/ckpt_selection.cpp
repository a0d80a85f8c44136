// Which file of a checkpoint folder is read, and that it can be read.
#include "anigen/io/checkpoint_folder.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/tensor_arrays.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

namespace fs = std::filesystem;

// "<folder>.regular" and "<folder>.ema" are flow models, "<folder>" is a decoder named "final".
fs::path choose(const fs::path& root, const std::string& name) {
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) return io::choose_decoder_checkpoint(root / name, "final");
  return io::choose_flow_checkpoint(root / name.substr(0, dot), name.substr(dot + 1) == "ema");
}

bool readable(const fs::path& file) {
  const io::NamedArrays arrays = io::read_state_dict(file);
  for (const auto& [key, array] : arrays) {
    if (key.compare(0, 7, "module.") == 0) return false;
    if (!torch::isfinite(models::to_tensor(array).to(torch::kFloat32)).all().item<bool>()) return false;
  }
  return !arrays.empty();
}

void run_ckpt_selection(Fixture& fixture) {
  const fs::path root = fixture.folder() / fixture.name();
  for (const auto& [name, expected] : fixture.config().at("expected_file").items()) {
    const fs::path file = choose(root, name);
    fixture.check_true(name + " reads " + file.filename().string() + ", expected " + expected.get<std::string>(),
                       file.filename() == expected.get<std::string>());
    fixture.check_true(name + ": finite tensors without the prefix module.", readable(file));
  }
  for (const std::string& output : fixture.outputs()) {
    fixture.defer(output, "the sparse-structure models are not built yet");
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ckpt_selection, anigen::test::run_ckpt_selection)
