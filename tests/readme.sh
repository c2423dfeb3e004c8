#!/usr/bin/env bash
# Runs every line of README.md that starts the program, in a copy of what is under version control.
#
#   tests/readme.sh PROGRAM
#
# Lines run as they are printed but for what makes them long: presets become draft, counts and times small. Nothing else is
# changed, and no line may fail, say that something was taken otherwise, or leave a file that git would show.
set -euo pipefail
program=$(realpath "$1")
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf -- "$work"' EXIT

# As a fresh clone.
git -C "$checkout" ls-files -z --cached --others --exclude-standard |
    (cd "$checkout" && tar --null --no-recursion -cf - -T -) | tar -xf - -C "$work"
mkdir "$work/bin"
ln -s "$program" "$work/bin/cardioid"
cd "$work"
git init -q . && git add -A -- . ':!bin'

# The same line with less to do.
quick() {
    local line=$1
    line=$(sed -E \
        -e 's/--quality (final|preview|reference)/--quality draft/' \
        -e 's/--spp [0-9]+/--spp 2/' \
        -e 's/--(global|caustic)-photons [0-9.e]+/--\1-photons 20000/g' \
        -e 's/--gather-samples [0-9]+/--gather-samples 4/' \
        -e 's/--time-limit [^ ]+/--time-limit 3s/' \
        -e 's/--time-budget [^ ]+/--time-budget 10s/' \
        -e 's/--target-error [^ ]+/--target-error 0.5/' \
        -e 's/--count [0-9]+/--count 5/' <<<"$line")
    case $line in
    *--photon-map*) ;;
    'cardioid render'*--integrator\ progressive* | *--target-error*) line+=' --resolution 64x64' ;;
    'cardioid render'*cornell*) ;; # 256 x 256, which references have
    'cardioid render'*--resolution*) line=$(sed -E 's/--resolution [^ ]+/--resolution 96x96/' <<<"$line") ;;
    'cardioid render'*) line+=' --resolution 96x72' ;;
    'cardioid part'*) line+=' --resolution 32x32 --global-photons 2000 --caustic-photons 2000' ;;
    'cardioid radiosity'*) line+=' --patches 1000 --quality draft --resolution 96x72' ;;
    'cardioid bake'*) line+=' --patches 1000' ;;
    'cardioid probe'*) line+=' --samples 16 --batches 2 --quality draft' ;;
    'cardioid tradeoff'*) line=$(sed -E 's/--resolution [^ ]+/--resolution 16x16/' <<<"$line")' --seeds 1 --around draft' ;;
    'cardioid bench'*) line+=' --rays 2000 --runs 1 --check 100' ;;
    'cardioid validate'*) line+=' --seeds 2' ;;
    esac
    case $line in
    *prism* | *water*) line+=' --global-photons 20000 --caustic-photons 20000' ;; # their scenes ask for 500,000
    esac
    case $line in
    'cardioid render'*--quality* | *--integrator\ progressive* | *--target-error* | 'cardioid photons'*--quality*) ;;
    'cardioid render'* | 'cardioid photons'*) line+=' --quality draft' ;;
    esac
    printf '%s\n' "$line"
}

# Lines of blocks of code, continued ones joined, without what follows a #.
lines() {
    sed -n '/^```sh$/,/^```$/p' README.md | sed -e ':a' -e '/\\$/{N;s/\\\n *//;ba}' | sed -e 's/ *#.*//' | grep -v -e '^```' -e '^ *$'
}

count=0 failed=0
while IFS= read -r line; do
    case $line in
    'cardioid '*) ;;
    './setup.sh && cargo install --locked --path .') continue ;;
    'mkdir -p out')
        mkdir -p out
        continue
        ;;
    'make '*) continue ;; # below
    *)
        printf 'readme: unknown line: %s\n' "$line"
        failed=$((failed + 1))
        continue
        ;;
    esac
    count=$((count + 1))
    short=$(quick "$line")
    status=0
    # shellcheck disable=SC2086 # the words of the line
    PATH="$work/bin:$PATH" $short >"$work/.stdout" 2>"$work/.stderr" </dev/null || status=$?
    # With two seeds nothing is told from noise; the defects that there are would be told all the same.
    if [[ $line == 'cardioid validate'* ]] && [ "$status" -eq 1 ] && ! grep -v 'from noise' "$work/.stderr" | grep -q '^error'; then
        status=0
    fi
    if [ "$status" -ne 0 ]; then
        printf 'readme: exit code %d: %s\n  as: %s\n' "$status" "$line" "$short"
        sed 's/^/  /' "$work/.stderr" | tail -n 5
        failed=$((failed + 1))
    fi
done < <(lines)
rm -f "$work/.stdout" "$work/.stderr"
rm -rf "$work/bin"
# What was there is staged and nothing else.
left=$(git status --porcelain --untracked-files=all | grep -v '^A  ' || true)
if [ -n "$left" ]; then
    printf 'readme: files that git would show:\n%s\n' "$left"
    failed=$((failed + 1))
fi
# Targets of make that the page names.
for target in $(grep -oE 'make [a-z]+' README.md | sort -u | sed 's/make //'); do
    if [ "$target" = check ] || make -n "$target" >/dev/null 2>&1; then continue; fi
    case " a at sense " in *" $target "*) continue ;; esac
    printf 'readme: there is no "make %s"\n' "$target"
    failed=$((failed + 1))
done
printf 'readme: %d lines, %d failures\n' "$count" "$failed"
[ "$failed" -eq 0 ] && [ "$count" -gt 25 ]
