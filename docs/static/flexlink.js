// Names for screen readers where the theme and the gallery leave them out; wide tables can be scrolled by keys.
document.addEventListener("DOMContentLoaded", () => {
  for (const button of document.querySelectorAll(".search-button-field")) {
    button.setAttribute("aria-label", button.textContent.replace(/\s+/g, " ").trim())
  }
  for (const summary of document.querySelectorAll("nav summary")) {
    const link = summary.closest("li")?.querySelector("a")
    summary.setAttribute("aria-label", `pages below ${link ? link.textContent.trim() : "this one"}`)
  }
  for (const link of document.querySelectorAll(".sphx-glr-thumbcontainer a")) {
    link.setAttribute("aria-label", link.textContent.trim())
  }
  for (const head of document.querySelectorAll(".bd-article th:empty")) {
    head.replaceWith(document.createElement("td"))  // the corner of a table of pandas
  }
  for (const table of document.querySelectorAll(".bd-article table")) {
    if (table.scrollWidth > table.clientWidth) table.tabIndex = 0
  }
})
