// parity_runner [--device cuda|counting] <name>…: computes fixtures of the published system and compares. With a device
// those whose handlers compute on one do so there; `counting` is tests/device/counting_device.h. Exit 0 pass, 1 fail,
// 77 all skipped.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/profile.h"
#include "tests/device/counting_device.h"
#include "tests/parity/registry.h"
#include "tests/support/paths.h"

namespace anigen::test {
namespace {

constexpr int kPassed = 0, kFailed = 1, kSkipped = 77;

int skip(const std::string& name, const std::string& reason) {
  std::printf("skipped: %s: %s\n", name.c_str(), reason.c_str());
  return kSkipped;
}

// Of something that ANIGEN_REQUIRE_FIXTURES=1 asks for.
int lack(const std::string& name, const std::string& reason) {
  if (!fixtures_are_required()) return skip(name, reason);
  std::printf("FAIL %s: %s, although ANIGEN_REQUIRE_FIXTURES=1 asks for it\n", name.c_str(), reason.c_str());
  return kFailed;
}

// Some fixtures of options that no published config uses do not say so themselves.
bool published_configs_need(const Fixture& fixture) {
  for (const char* name : {"ops_sparse_attn_serialized", "ops_sparse_layernorm_quirk", "ops_dense_rope"}) {
    if (fixture.name() == name) return false;
  }
  return fixture.json().value("used_by_official_config", true);
}

// The device of that name; nothing where there is none.
std::optional<torch::Device> device_named(const std::string& name) {
  if (name == "counting") return counting_device();
  if (name != "cpu" && !torch::cuda::is_available()) return std::nullopt;
  return nn::parse_device(name);
}

int run(const std::string& name, torch::Device device) {
  // `state_dict_spec.<config>` is the file of that name in the folder state_dict_spec.
  std::string file = name;
  const std::string specs = "state_dict_spec.";
  if (name.compare(0, specs.size(), specs) == 0) file[specs.size() - 1] = '/';
  const std::filesystem::path json = parity_file(file + ".json");
  if (!std::filesystem::exists(json)) return lack(name, "no such fixture");
  const ParityEntry* const entry = find_parity_handler(name);
  if (entry == nullptr) return lack(name, "belongs to a part that is not built yet");
  if (!device.is_cpu() && !entry->on_device) return skip(name, "computes on the host alone");
  std::filesystem::path folder = json.parent_path();
  if (file != name) folder = folder.parent_path();
  std::printf("fixture from %s\n", std::filesystem::weakly_canonical(folder).c_str());
  Fixture fixture(folder, file, device);
  try {
    entry->handler(fixture);
  } catch (const NotSupportedError& error) {
    if (published_configs_need(fixture)) throw;
    return skip(name, error.what());
  }
  return fixture.finish() ? kPassed : kFailed;
}

}  // namespace

std::vector<ParityEntry>& parity_entries() {
  static std::vector<ParityEntry> entries;
  return entries;
}

const ParityEntry* find_parity_handler(const std::string& fixture) {
  const ParityEntry* best = nullptr;
  for (const ParityEntry& entry : parity_entries()) {
    const bool prefix = fixture.compare(0, entry.name.size(), entry.name) == 0;
    if (prefix && (best == nullptr || entry.name.size() > best->name.size())) best = &entry;
  }
  return best;
}

// As run(), with every error told.
int run_and_tell(const std::string& name, torch::Device device) {
  try {
    return run(name, device);
  } catch (const NotBuiltYet& part) {
    return lack(name, part.what + " belongs to a part that is not built yet");
  } catch (const std::exception& error) {
    std::printf("FAIL %s: %s\n", name.c_str(), error.what());
    return kFailed;
  }
}

}  // namespace anigen::test

int main(int argc, char** argv) {
  using namespace anigen::test;
  std::vector<std::string> names(argv + 1, argv + argc);
  std::string device_name = "cpu";
  if (names.size() > 2 && names[0] == "--device") {
    device_name = names[1];
    names.erase(names.begin(), names.begin() + 2);
  }
  if (names.empty()) {
    std::fprintf(stderr, "usage: parity_runner [--device cuda|counting] <fixture>...\n");
    return 2;
  }
  if (device_name != "cpu" && device_name != "cuda" && device_name != "counting") {
    std::fprintf(stderr, "no device %s: cpu, cuda or counting\n", device_name.c_str());
    return 2;
  }
  const std::optional<torch::Device> device = device_named(device_name);
  if (!device) {
    std::printf("skipped: there is no device %s\n", device_name.c_str());
    return 77;
  }
  std::vector<int> codes;
  for (const std::string& name : names) {
    if (names.size() > 1) std::printf("%s\n", name.c_str());
    codes.push_back(run_and_tell(name, *device));
  }
  if (std::count(codes.begin(), codes.end(), 1) > 0) return 1;
  return std::count(codes.begin(), codes.end(), 0) > 0 ? 0 : 77;
}
