#include "anigen/prepare/card/dataset_card.h"

#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/io/image.h"
#include "anigen/prepare/card/card_facts.h"
#include "anigen/prepare/card/card_pages.h"
#include "anigen/prepare/card/card_pictures.h"

namespace anigen::prepare {

void write_card(const std::filesystem::path& out, const DatasetRows& found, const CsvTable& table, const StepPlan& plan,
                const QualityLimits& limits) {
  const CardFacts facts = card_facts(found, plan, limits);
  const std::optional<io::Image> sheet = card_pictures(out, found.rows);
  std::vector<std::uint8_t> picture;
  if (sheet) {
    picture = io::encode_png(*sheet);
    io::write_png(out / "card.png", *sheet);
  } else {
    std::error_code ignored;
    std::filesystem::remove(out / "card.png", ignored);
  }
  write_file_atomically(out / "card.md", card_markdown(facts, table.columns, sheet.has_value()));
  write_file_atomically(out / "card.html", card_html(facts, table.columns, picture));
}

}  // namespace anigen::prepare
