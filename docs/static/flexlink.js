// Names for screen readers where the theme and the gallery leave them out; wide tables can be scrolled by keys; hits of
// the search open at their section.
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
  const results = document.getElementById("search-results")
  if (results) results.addEventListener("click", keepWords)
  else openAtHit()
})

// A hit of the search opens at the first section that contains most of the words.
function keepWords() {
  sessionStorage.setItem("words", new URLSearchParams(location.search).get("q") ?? "")
}

function openAtHit() {
  const words = (sessionStorage.getItem("words") ?? "").toLowerCase().split(/\s+/).filter(Boolean)
  sessionStorage.removeItem("words")
  if (location.hash) return
  let best = null, most = 0
  for (const section of document.querySelectorAll(".bd-article section")) {
    const own = [...section.children].filter((each) => each.tagName !== "SECTION")
    const text = own.map((each) => each.textContent).join(" ").toLowerCase()
    const found = words.filter((word) => text.includes(word)).length
    if (found > most) [best, most] = [section, found]
  }
  best?.scrollIntoView()
}
