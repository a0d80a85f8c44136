#include "anigen/sparse/support.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {
namespace {

using Place = std::vector<std::int64_t>;  // item, x, y, z

std::vector<Place> places_of(const Support& support) {
  std::vector<Place> places;
  const auto* c = support.coords().data_ptr<std::int32_t>();
  for (std::int64_t row = 0; row < support.size(); ++row, c += 4) places.push_back(Place(c, c + 4));
  return places;
}

std::map<Place, std::int64_t> rows_by_place(const Support& support) {
  std::map<Place, std::int64_t> rows;
  for (const Place& place : places_of(support)) rows.emplace(place, static_cast<std::int64_t>(rows.size()));
  return rows;
}

Tensor coords_of(const std::vector<std::int64_t>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64))
      .view({static_cast<std::int64_t>(values.size()) / 4, 4});
}

std::string refusal_of(const Tensor& coords, std::int64_t items = 0) {
  try {
    Support::create(coords, items);
  } catch (const InputError& error) {
    return error.place() + "|" + error.problem();
  }
  return "accepted";
}

void expect_neighbours_by_brute_force(const Support& support) {
  const std::map<Place, std::int64_t> rows = rows_by_place(support);
  ASSERT_EQ(static_cast<std::int64_t>(rows.size()), support.size());
  const Tensor& found = support.neighbours();
  ASSERT_EQ(found.sizes(), (std::vector<std::int64_t>{27, support.size()}));
  for (const auto& [place, row] : rows) {
    for (std::int64_t tap = 0; tap < 27; ++tap) {
      const Place other{place[0], place[1] + tap / 9 - 1, place[2] + tap / 3 % 3 - 1, place[3] + tap % 3 - 1};
      const auto wanted = rows.find(other);
      ASSERT_EQ(found[tap][row].item<std::int64_t>(), wanted == rows.end() ? -1 : wanted->second)
          << "tap " << tap << " of row " << row;
    }
  }
}

TEST(Support, KeepsRowsAndCountsItems) {
  const Tensor coords = coords_of({0, 5, 1, 2, 0, 0, 0, 0, 2, 1, 1, 1});
  const SupportPtr support = Support::create(coords);
  EXPECT_TRUE(torch::equal(support->coords(), coords.to(torch::kInt32)));
  EXPECT_EQ(support->items().lengths(), (std::vector<std::int64_t>{2, 0, 1}));
  EXPECT_EQ(Support::create(coords, 5)->items().lengths(), (std::vector<std::int64_t>{2, 0, 1, 0, 0}));
  const Tensor wanted = torch::tensor({0.1875, -0.3125, -0.1875});
  EXPECT_TRUE(torch::equal(support->centers(8)[0], wanted.to(torch::kFloat32)));
}

TEST(Support, NoVoxels) {
  const SupportPtr support = Support::create(torch::zeros({0, 4}, torch::kInt32), 2);
  EXPECT_EQ(support->size(), 0);
  EXPECT_EQ(support->items().items(), 2);
  EXPECT_EQ(support->neighbours().numel(), 0);
  EXPECT_EQ(support->windows(8, 4).offsets.size(0), 1);
  EXPECT_EQ(support->windows(8, 4).longest, 0);
  EXPECT_EQ(support->subdivided()->items().items(), 2);
  EXPECT_EQ(support->coarsened(2).support->items().items(), 2);
  EXPECT_EQ(Support::create(torch::zeros({0, 4}, torch::kInt64))->items().items(), 0);
}

TEST(Support, RefusesWhatIsNoSupport) {
  EXPECT_NE(refusal_of(torch::zeros({3, 3}, torch::kInt32)).find("[3, 3]"), std::string::npos);
  EXPECT_NE(refusal_of(torch::zeros({3, 4})).find("Float"), std::string::npos);
  EXPECT_NE(refusal_of(Tensor()).find("nothing"), std::string::npos);
  EXPECT_EQ(refusal_of(coords_of({0, 1, 2, 3, 0, 1, 2, 4, 0, 1, 2, 3})).rfind("row 2|", 0), 0U) << "a voxel twice";
  EXPECT_EQ(refusal_of(coords_of({1, 1, 2, 3, 0, 1, 2, 3})).rfind("row 1|", 0), 0U) << "items out of order";
  EXPECT_EQ(refusal_of(coords_of({0, 1, 2, 3, 0, 1, -1, 3})).rfind("row 1|", 0), 0U) << "below the grid";
  EXPECT_EQ(refusal_of(coords_of({0, 1, 2, 1 << 20})).rfind("row 0|", 0), 0U) << "beyond the grid";
  EXPECT_EQ(refusal_of(coords_of({0, 1, 2, std::int64_t{1} << 40})).rfind("row 0|", 0), 0U) << "not cut to 32 bits";
  EXPECT_EQ(refusal_of(coords_of({-1, 1, 2, 3})).rfind("row 0|", 0), 0U) << "an item below zero";
  EXPECT_EQ(refusal_of(coords_of({std::int64_t{1} << 31, 1, 2, 3})).rfind("row 0|", 0), 0U) << "no memory for items";
  EXPECT_EQ(refusal_of(coords_of({2, 1, 2, 3}), 2).rfind("row 0|", 0), 0U) << "more items than promised";
  EXPECT_EQ(refusal_of(coords_of({0, 1, 2, 3, 1, 1, 2, 3})), "accepted") << "the same voxel of two items";
}

TEST(Support, NeighboursAgreeWithBruteForce) {
  torch::manual_seed(1);
  expect_neighbours_by_brute_force(*Support::create(cases::random_voxels({60, 1, 100}, 5)));
  expect_neighbours_by_brute_force(*Support::create(cases::random_voxels({0, 700}, 9)));
}

TEST(Support, NeighboursAtTheBordersOfTheLargestGrid) {
  constexpr std::int64_t kEnd = (1 << 20) - 1;
  // Places whose neighbours, were a row or a plane of the grid to wrap around, would be each other.
  expect_neighbours_by_brute_force(
      *Support::create(coords_of({0, kEnd, kEnd, kEnd, 0, 0, 0, 0, 0,    kEnd, kEnd, kEnd - 1, 0, 0, 0, kEnd, 0, 0,
                                  1, 0,    0,    1,    0, 0, 0, 0, kEnd, kEnd, 1,    0,        0, 0, 1, kEnd, 0, 0})));
}

TEST(Support, NeighbourRelationIsSymmetric) {
  torch::manual_seed(2);
  const SupportPtr support = Support::create(cases::random_voxels({300, 200}, 8));
  const Tensor& found = support->neighbours();
  for (std::int64_t tap = 0; tap < 27; ++tap) {
    const Tensor rows = found[tap].ge(0).nonzero().squeeze(1);
    const Tensor others = found[tap].index_select(0, rows).to(torch::kInt64);
    EXPECT_TRUE(torch::equal(found[26 - tap].index_select(0, others).to(torch::kInt64), rows)) << "tap " << tap;
  }
}

TEST(Support, WindowsAgreeWithBruteForce) {
  torch::manual_seed(3);
  const SupportPtr support = Support::create(cases::random_voxels({150, 0, 90}, 11));
  const std::vector<Place> places = places_of(*support);
  const std::vector<std::pair<std::int64_t, std::int64_t>> kinds{{4, 0}, {4, 2}, {8, 4}, {1, 0}, {64, 3}};
  for (const auto& [size, shift] : kinds) {
    Place extent(3, 0);
    for (const Place& place : places) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        extent[axis] = std::max(extent[axis], (place[axis + 1] + shift) / size + 1);
    }
    std::map<std::int64_t, std::vector<std::int64_t>> rows;  // by number, ascending
    for (std::size_t row = 0; row < places.size(); ++row) {
      std::int64_t number = places[row][0];
      for (std::size_t axis = 0; axis < 3; ++axis)
        number = number * extent[axis] + (places[row][axis + 1] + shift) / size;
      rows[number].push_back(static_cast<std::int64_t>(row));
    }
    const WindowOrder& windows = support->windows(size, shift);
    ASSERT_EQ(windows.windows.size(0), static_cast<std::int64_t>(rows.size()));
    std::int64_t window = 0, longest = 0;
    for (const auto& [number, members] : rows) {
      EXPECT_EQ(windows.windows[window].item<std::int64_t>(), number);
      const auto count = static_cast<std::int64_t>(members.size()),
                 first = windows.offsets[window].item<std::int64_t>();
      ASSERT_EQ(windows.offsets[window + 1].item<std::int64_t>(), first + count);
      EXPECT_TRUE(torch::equal(windows.order.host().narrow(0, first, count), torch::tensor(members, torch::kInt64)));
      longest = std::max(longest, count);
      ++window;
    }
    EXPECT_EQ(windows.longest, longest);
    EXPECT_TRUE(
        torch::equal(windows.order.host().index_select(0, windows.place.host()), torch::arange(support->size())));
  }
}

TEST(Support, RefusesImpossibleWindows) {
  const SupportPtr support = Support::create(coords_of({0, (1 << 20) - 1, (1 << 20) - 1, (1 << 20) - 1}), 1 << 10);
  EXPECT_THROW(support->windows(0, 0), InputError);
  EXPECT_THROW(support->windows(8, -1), InputError);
  EXPECT_THROW(support->windows(1, 0), InputError) << "their numbers need 70 bits";
  EXPECT_EQ(support->windows(8, 4).windows.size(0), 1) << "after a refusal";
}

TEST(Support, SubdivisionPutsEightChildrenInARow) {
  const SupportPtr fine = Support::create(coords_of({0, 3, 0, 1, 1, 0, 2, 5}))->subdivided();
  ASSERT_EQ(fine->size(), 16);
  EXPECT_EQ(fine->items().lengths(), (std::vector<std::int64_t>{8, 8}));
  for (std::int64_t child = 0; child < 8; ++child) {
    EXPECT_TRUE(torch::equal(fine->coords()[child].to(torch::kInt64),
                             coords_of({0, 6 + child / 4, child / 2 % 2, 2 + child % 2})[0]));
    EXPECT_TRUE(torch::equal(fine->coords()[8 + child].to(torch::kInt64),
                             coords_of({1, child / 4, 4 + child / 2 % 2, 10 + child % 2})[0]));
  }
  expect_neighbours_by_brute_force(*fine);
  EXPECT_THROW(Support::create(coords_of({0, 1 << 19, 0, 0}))->subdivided(), InputError);
}

TEST(Support, CoarseVoxelsAreSortedAndCounted) {
  torch::manual_seed(4);
  const SupportPtr support = Support::create(cases::random_voxels({80, 0, 50}, 7));
  for (const GridFactor& factor : {GridFactor(1), GridFactor(2), GridFactor(3), GridFactor(100), GridFactor(1, 2, 4),
                                   GridFactor(3, 1, 1), GridFactor(1, 1, 100), GridFactor(2, 7, 1)}) {
    const Coarsening& coarse = support->coarsened(factor);
    const std::vector<Place> fine = places_of(*support), places = places_of(*coarse.support);
    EXPECT_TRUE(std::is_sorted(places.begin(), places.end()));
    EXPECT_EQ(coarse.support->items().items(), 3);
    std::vector<std::int64_t> count(places.size(), 0);
    for (std::size_t row = 0; row < fine.size(); ++row) {
      const auto at = static_cast<std::size_t>(coarse.row.host()[static_cast<std::int64_t>(row)].item<std::int64_t>());
      Place wanted = fine[row];
      for (std::size_t axis = 1; axis < 4; ++axis) wanted[axis] /= factor.axes[axis - 1];
      EXPECT_EQ(places.at(at), wanted);
      ++count[at];
    }
    EXPECT_TRUE(torch::equal(coarse.count.host(), torch::tensor(count, torch::kInt64)));
  }
  EXPECT_THROW(support->coarsened(0), InputError);
  EXPECT_THROW(support->coarsened({2, 2, 0}), InputError);
  EXPECT_THROW(support->coarsened({2, -1, 2}), InputError);
}

TEST(Support, DerivedThingsAreSharedAndMadeOnce) {
  torch::manual_seed(5);
  const SupportPtr support = Support::create(cases::random_voxels({400}, 9));
  std::vector<const void*> seen(8);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    threads.emplace_back([&, i] {
      support->windows(4, 2);
      support->coarsened(2);
      support->subdivided()->neighbours();
      seen[i] = support->neighbours().data_ptr();
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const void* data : seen) EXPECT_EQ(data, support->neighbours().data_ptr());
  EXPECT_EQ(&support->windows(4, 2), &support->windows(4, 2));
  EXPECT_EQ(support->subdivided(), support->subdivided());
  EXPECT_EQ(support->coarsened(2).support, support->coarsened(2).support);
  EXPECT_EQ(support->coarsened({2, 2, 2}).support, support->coarsened(2).support);
  EXPECT_NE(support->coarsened({1, 2, 2}).support, support->coarsened({2, 2, 1}).support);
}

TEST(SortKeys, StableForKeysOfAnySize) {
  torch::manual_seed(6);
  for (const int bits : {1, 12, 40, 63}) {
    std::vector<std::uint64_t> keys;
    for (int i = 0; i < 500; ++i) {
      keys.push_back(static_cast<std::uint64_t>(torch::randint(0, 1 << 30, {1}).item<std::int64_t>()) << 33 >>
                     (63 - bits));
    }
    std::vector<std::pair<std::uint64_t, std::int32_t>> wanted;
    for (std::size_t i = 0; i < keys.size(); ++i) wanted.emplace_back(keys[i], static_cast<std::int32_t>(i));
    std::sort(wanted.begin(), wanted.end());
    const SortedKeys sorted = sort_keys(keys);
    for (std::size_t i = 0; i < keys.size(); ++i) {
      ASSERT_EQ(sorted.keys[i], wanted[i].first);
      ASSERT_EQ(sorted.rows[i], wanted[i].second);
    }
  }
}

}  // namespace
}  // namespace anigen::sparse
