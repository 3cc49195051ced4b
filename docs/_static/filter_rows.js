// A field above tables of symptoms: only rows that have all of its words stay.
document.addEventListener("DOMContentLoaded", () => {
  const rows = [...document.querySelectorAll("table")]
    .filter((table) => table.tHead?.rows[0].cells[0].textContent.trim() === "what you see")
    .flatMap((table) => [...table.tBodies[0].rows]);
  if (rows.length === 0) return;
  const field = document.createElement("input");
  field.type = "search";
  field.placeholder = "Show rows with …";
  field.setAttribute("aria-label", field.placeholder);
  field.style.cssText = "width: 100%; padding: 0.4em; margin-bottom: 1em; font-size: inherit";
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    for (const row of rows)
      row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
  });
  document.querySelector("h1").after(field);
});
