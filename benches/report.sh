#!/usr/bin/env bash
# Checks the report of `cardioid tradeoff` in a headless browser (Chromium, or Chrome): that nothing fails, that pictures load, that slider,
# difference, factor and circles do what they say. Needs a built program and a browser; a quarter of a minute.
#
#   benches/report.sh [REPORT]     the report of a small sweep, or this one
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=${CARDIOID:-target/release/cardioid}
for browser in chromium chromium-browser google-chrome; do
    command -v "$browser" >/dev/null && break
done
command -v "$browser" >/dev/null || { echo "no Chromium or Chrome is installed" >&2; exit 2; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
report=${1:-}
if [ -z "$report" ]; then
    [ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
    "$program" tradeoff scenes/cornell-spheres.toml --resolution 64x64 --seeds 2 --around draft,preview --knobs spp --reference-time 3s -q -o "$out/sweep"
    report=$out/sweep/report.html
fi
# What a person would do, appended to the page, with what came of it.
{
    cat "$report"
    cat <<'END'
<pre id="checked"></pre>
<script>
const lines = [];
const check = (what, holds) => lines.push(`${holds ? "ok" : "FAILED"}: ${what}`);
window.addEventListener("error", (event) => check(event.message, false));
const turn = (id, value) => {
  element(id).value = value;
  element(id).dispatchEvent(new Event(element(id).tagName === "SELECT" ? "change" : "input"));
};
const view = (name) => document.querySelector(`[name=view][value=${name}]`).click();
const soon = () => new Promise((resolve) => setTimeout(resolve, 100));
// Pictures are decoded beside what runs here.
const until = async (what, holds) => {
  for (let i = 0; i < 100 && !holds(); i++) await soon();
  check(what, holds());
};
const brightness = () => {
  const canvas = element("canvas");
  if (canvas.hidden || canvas.width === 0) return -1;
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return data.reduce((sum, value, i) => sum + (i % 4 === 3 ? 0 : value), 0);
};
(async () => {
  const [left, right] = [element("left"), element("right")];
  check(`${pictures.length} pictures, each in both lists`, pictures.length > 1 &&
    ["a", "b"].every((id) => element(id).options.length === pictures.length));
  await until("both pictures are shown", () => left.naturalWidth > 0 && left.naturalWidth === right.naturalWidth && !left.hidden);
  for (const at of [0, 25, 100]) {
    turn("slider", at);
    check(`the border is at ${at} %`, element("line").style.left === `${at}%` && left.style.clipPath.includes(`${100 - at}%`));
  }
  for (let i = 0; i < pictures.length; i++) {
    turn("a", i);
    await until(`${pictures[i].name} is shown`, () => left.src === pictures[i].data && left.naturalWidth > 0);
  }
  view("difference");
  turn("a", 1); turn("b", 0); turn("gain", 1);
  await until("the difference is shown", () => brightness() > 0 && left.hidden);
  const once = brightness();
  turn("gain", 16);
  await until("there is more of it times 16", () => brightness() > once);
  turn("b", 1);
  await until("of a picture with itself there is none", () => brightness() === 0);
  view("slider");
  const circles = document.querySelectorAll("circle[data-cell]");
  check("a circle for each render", circles.length === pictures.length - 1);
  circles[circles.length - 1].dispatchEvent(new Event("click"));
  await until("a click on a circle shows its picture", () => left.src === pictures[pictures.length - 1].data && !left.hidden);
  check("tables have rows", [...document.querySelectorAll("table")].every((table) => table.rows.length > 1));
  check("nothing is loaded from elsewhere", performance.getEntriesByType("resource").every((entry) => entry.name.startsWith("data:")));
  lines.push("end");
  element("checked").textContent = lines.join("\n");
})();
</script>
END
} >"$out/page.html"
"$browser" --headless --no-sandbox --disable-gpu --no-first-run --user-data-dir="$out/profile" --virtual-time-budget=60000 \
    --dump-dom "file://$out/page.html" 2>"$out/log" |
    sed -n '/<pre id="checked">/,/<\/pre>/p' | sed 's/<[^>]*>//g' >"$out/checked"
cat "$out/checked"
grep -q '^end$' "$out/checked" || { echo "the page did not come to its end:" >&2; tail -n 5 "$out/log" >&2; exit 1; }
! grep -q FAILED "$out/checked"
