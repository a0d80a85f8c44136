#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace anigen::prepare {

/// Chooses test entries: the `count` ids with the smallest hash of (seed, id). The choice does not depend on the
/// order of the ids, and adding an id moves at most one other across the border.
/// @return one flag per id, true for test @pre ids are unique
std::vector<bool> choose_test(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed);

/// round(fraction · n). @throws InputError when the fraction is not in [0, 1]
std::size_t test_count(std::size_t n, double fraction);

}  // namespace anigen::prepare
