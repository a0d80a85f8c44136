#!/usr/bin/env bash
# Refuses comments of the sources that open a line as a riddle (with What, Which, Where, How, Who, Whether or "The same":
# the first sentence of a comment says what the thing is or does), and those that cite a page, or a section of a page,
# that is not in the repository.
#   scripts/lint_comments.sh [folder…, default: anigen tests benchmarks examples]
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- anigen tests benchmarks examples
status=0

found=$(grep -rnE --include='*.h' --include='*.cpp' --include='*.inc' \
  '^[[:space:]]*///?<? *(What|Which|Where|How|Who|Whether|The same)([^[:alnum:]_]|$)' "${@}" || true)
if [[ -n $found ]]; then
  echo "$found"
  echo "error: $(wc -l <<<"$found") comments open as a riddle; say what the thing is or does" >&2
  status=1
fi

# Pages are named by their path from the root; names of files that programs write (table.md, card.md, …) are no citations.
found=$(find "${@}" -name '*.h' -o -name '*.cpp' -o -name '*.inc' | sort | xargs perl -e '
  my (%sections, %seen);
  sub sections {
    my ($page) = @_;
    return $sections{$page} if $sections{$page};
    my %of;
    if (open(my $in, "<", $page)) { while (<$in>) { $of{$1} = 1 if /^#+ ([0-9]+(?:\.[0-9]+)?) /; } }
    return $sections{$page} = \%of;
  }
  foreach my $file (@ARGV) {
    open(my $in, "<", $file) or die "$file: $!";
    my ($text, $line) = ("", 0);
    my @lines = (<$in>, "\n");
    for my $i (0 .. $#lines) {
      if ($lines[$i] =~ m{(?:^|[\s;{},)])//[/!]?<?\s*(.*)}) {
        $line = $i + 1 if $text eq "";
        $text .= ($text eq "" ? "" : " ") . $1;
        next if $lines[$i] =~ m{^\s*//};
        next if $i < $#lines && $lines[$i + 1] =~ m{^\s*//};
      }
      while ($text =~ m{(\b[Rr]eference )?([\w./-]*\w\.md)((?:,| and)? (?:\d+(?:\.\d+)?(?:, | and )?)+)?}g) {
        my ($before, $page, $numbers) = ($1, $2, $3 // "");
        my $why = "";
        if (-f $page) {
          if ($page =~ m{^docs/reference/}) {
            my $has = sections($page);
            foreach my $number ($numbers =~ /(\d+(?:\.\d+)?)/g) { $why = "$page has no section $number" unless $has->{$number}; }
          }
        } elsif ($before || $page =~ m{^(docs|datasets|third_party|experiments|tests)/} || $page =~ m{-}) {
          $why = "$page is not in the repository";
        }
        print "$file:$line: $why\n" if $why;
      }
      $text = "";
    }
  }')
if [[ -n $found ]]; then
  echo "$found"
  echo "error: $(wc -l <<<"$found") citations of pages or sections that are not in the repository" >&2
  status=1
fi
exit $status
