#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/prepare/card/card_facts.h"

namespace anigen::prepare {

/// @param columns of metadata.csv @param picture card.png is there
std::string card_markdown(const CardFacts& facts, const std::vector<std::string>& columns, bool picture);

/// One file without references to others. @param picture PNG bytes; empty: none
std::string card_html(const CardFacts& facts, const std::vector<std::string>& columns,
                      const std::vector<std::uint8_t>& picture);

}  // namespace anigen::prepare
