// parity_runner <name>: computes one fixture of the published system and compares. Exit 0 pass, 1 fail, 77 skipped.
#include <cstdio>
#include <exception>
#include <filesystem>

#include "anigen/core/error.h"
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

int run(const std::string& name) {
  // `state_dict_spec.<config>` is the file of that name in the folder state_dict_spec.
  std::string file = name;
  const std::string specs = "state_dict_spec.";
  if (name.compare(0, specs.size(), specs) == 0) file[specs.size() - 1] = '/';
  const std::filesystem::path json = parity_file(file + ".json");
  if (!std::filesystem::exists(json)) return lack(name, "no such fixture");
  const ParityHandler handler = find_parity_handler(name);
  if (handler == nullptr) return lack(name, "belongs to a part that is not built yet");
  std::filesystem::path folder = json.parent_path();
  if (file != name) folder = folder.parent_path();
  std::printf("fixture from %s\n", std::filesystem::weakly_canonical(folder).c_str());
  Fixture fixture(folder, file);
  try {
    handler(fixture);
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

ParityHandler find_parity_handler(const std::string& fixture) {
  const ParityEntry* best = nullptr;
  for (const ParityEntry& entry : parity_entries()) {
    const bool prefix = fixture.compare(0, entry.name.size(), entry.name) == 0;
    if (prefix && (best == nullptr || entry.name.size() > best->name.size())) best = &entry;
  }
  return best == nullptr ? nullptr : best->handler;
}

}  // namespace anigen::test

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: parity_runner <fixture>\n");
    return 2;
  }
  try {
    return anigen::test::run(argv[1]);
  } catch (const anigen::test::NotBuiltYet& part) {
    return anigen::test::lack(argv[1], part.what + " belongs to a part that is not built yet");
  } catch (const std::exception& error) {
    std::printf("FAIL %s: %s\n", argv[1], error.what());
    return 1;
  }
}
