// The loader's part of the published data path: skin weights as stored, balanced micro-batches.
#include <algorithm>

#include "anigen/data/batches.h"
#include "anigen/data/view_files.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_skeleton_load(Fixture& fixture) {
  const Tensor raw = fixture.input("skin").contiguous(),
               stored = fixture.input("parents").to(torch::kInt32).contiguous();
  const auto joints = static_cast<std::size_t>(raw.size(1));
  std::vector<float> skin(raw.data_ptr<float>(), raw.data_ptr<float>() + raw.numel());
  const std::vector<int> parents(stored.data_ptr<int>(), stored.data_ptr<int>() + stored.numel());
  const auto tensor = [&] { return torch::tensor(skin).reshape(raw.sizes()); };
  data::normalize_skin_rows(skin, joints);
  fixture.check("skin", tensor());
  fixture.check("parents", torch::tensor(parents, torch::kInt32));
  data::accumulate_skin_as_flow(skin, parents);
  fixture.check("skin_flow", tensor());
}

void check_groups(Fixture& fixture, const std::string& suffix, bool equal_size) {
  const Tensor loads = fixture.input("loads").to(torch::kInt64).contiguous();
  const std::vector<std::uint64_t> values(loads.data_ptr<std::int64_t>(),
                                          loads.data_ptr<std::int64_t>() + loads.numel());
  const auto groups = data::balanced_groups(values, fixture.config().at("num_groups").get<std::size_t>(), equal_size);
  Tensor group_of = torch::full_like(loads, -1), order = torch::full_like(loads, -1);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (std::size_t i = 0; i < groups[g].size(); ++i) {
      group_of[static_cast<std::int64_t>(groups[g][i])] = static_cast<std::int64_t>(g);
      order[static_cast<std::int64_t>(groups[g][i])] = static_cast<std::int64_t>(i);
    }
  }
  fixture.check("group_of" + suffix, group_of);
  fixture.check("order_in_group" + suffix, order);
}

void run_balanced_groups(Fixture& fixture) {
  check_groups(fixture, "", false);
  check_groups(fixture, "_equal", true);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_data_skeleton_load, anigen::test::run_skeleton_load)
ANIGEN_PARITY(ops_train_balanced_groups, anigen::test::run_balanced_groups)
