// Tables that a reader filters by words, sorts by a column, and from which curves are chosen for a chart.
"use strict";
{
  const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹", lowered = (power) => [...power].map((each) => (each === "⁻" ? "-" : RAISED.indexOf(each))).join("");
  const numeric = (text) => parseFloat(text.replaceAll("\u2212", "-").replace(/×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/, (_, power) => `e${lowered(power)}`));

  const MOST_ROWS = 100; // a reader looks through no more, and searches in the others

  function filter(table, words, said) {
    const sought = words.toLowerCase().split(/\s+/).filter(Boolean), rows = [...table.tBodies[0].rows];
    let n = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase(), isFound = sought.every((word) => text.includes(word));
      n += isFound;
      row.hidden = !isFound || n > MOST_ROWS;
    }
    const shown = n > MOST_ROWS ? `, the first ${MOST_ROWS} are shown` : "";
    said.textContent = sought.length || shown ? `${n} of ${rows.length} rows${shown}` : "";
  }

  function sort(table, column, button, again) {
    const falls = button.dataset.order === "ascending", sign = falls ? -1 : 1, body = table.tBodies[0];
    const value = (row) => row.cells[column].textContent.trim();
    const rows = [...body.rows], numbers = rows.map((row) => numeric(value(row)));
    const isNumeric = numbers.some((each) => !Number.isNaN(each)) && rows.every((row, k) => !Number.isNaN(numbers[k]) || value(row) === "-")
      && !rows.some((row) => /^\d{4}-\d\d-\d\d/.test(value(row)));
    const last = sign > 0 ? Infinity : -Infinity;
    const key = new Map(rows.map((row, k) => [row, isNumeric ? (Number.isNaN(numbers[k]) ? last : numbers[k]) : value(row)]));
    rows.sort((a, b) => sign * (key.get(a) < key.get(b) ? -1 : key.get(a) > key.get(b) ? 1 : 0));
    body.append(...rows);
    again();
    for (const each of table.tHead.querySelectorAll("button")) delete each.dataset.order, each.parentNode.removeAttribute("aria-sort");
    button.dataset.order = falls ? "descending" : "ascending";
    button.parentNode.setAttribute("aria-sort", button.dataset.order);
  }

  for (const table of document.querySelectorAll("table.sorted")) {
    const field = table.closest(".scroll").previousElementSibling, sought = field.querySelector("input");
    const again = () => filter(table, sought.value, field.querySelector("output"));
    sought.addEventListener("input", again);
    again();
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button", button.textContent = head.textContent || "name";
      head.replaceChildren(button);
      button.addEventListener("click", () => sort(table, column, button, again));
    });
    table.addEventListener("change", ({ target }) => {
      if (!target.dataset.curve) return;
      const detail = { chart: table.dataset.overlay, curve: target.dataset.curve, on: target.checked };
      document.dispatchEvent(new CustomEvent("choose", { detail }));
    });
  }
}
