"""What a browser makes of a page, as plain values: a script that tests run in it."""

from __future__ import annotations

SEEING = r"""
() => {
  const channels = text => (text.match(/[\d.]+/g) || []).map(Number);
  const linear = part => part <= 10.3 ? part / 3294.6 : Math.pow((part / 255 + 0.055) / 1.055, 2.4);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const behind = element => {
    for (let each = element; each; each = each.parentElement) {
      const found = channels(getComputedStyle(each).backgroundColor);
      if (found.length === 3 || found[3] > 0) return found;
    }
    return [255, 255, 255];
  };
  const contrast = element => {
    const [a, b] = [channels(getComputedStyle(element).color), behind(element)].map(luminance);
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  };
  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    if (walker.currentNode.textContent.trim()) {
      const element = walker.currentNode.parentElement;
      texts.push({
        text: walker.currentNode.textContent.trim(), contrast: contrast(element),
        size: parseFloat(getComputedStyle(element).fontSize),
      });
    }
  }
  const colours = image => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const dots = new Uint32Array(context.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    return new Set(dots).size;
  };
  const images = [...document.images].map(image => ({
    alt: image.alt, width: image.naturalWidth, shown: image.clientWidth, complete: image.complete,
    colours: image.naturalWidth ? colours(image) : 0,
    ratio: image.clientWidth / image.clientHeight * image.naturalHeight / image.naturalWidth,
  }));
  const cells = row => [...row.cells].map(cell => cell.innerText.trim().replaceAll("\u00a0", " "));
  const tables = [...document.querySelectorAll("table")].map(table => ({
    head: table.tHead && table.tHead.rows.length === 1 && [...table.tHead.rows[0].cells].every(c => c.tagName === "TH")
      ? cells(table.tHead.rows[0]) : [],
    rows: [...table.tBodies].flatMap(body => [...body.rows].map(cells)),
    scrolls: table.parentElement.scrollWidth > table.parentElement.clientWidth,
    may_scroll: getComputedStyle(table.parentElement).overflowX === "auto" && table.parentElement.tabIndex === 0,
  }));
  const badge = document.querySelector(".badge"), first = document.querySelector("h1 + *");
  return {
    language: document.documentElement.lang, title: document.title, texts, images, tables,
    page_scrolls: document.documentElement.scrollWidth > innerWidth,
    headings: [...document.querySelectorAll("h1,h2,h3,h4,h5,h6")].map(each => Number(each.tagName[1])),
    badge: badge && {
      text: badge.innerText, bottom: badge.getBoundingClientRect().bottom, first: first && first.contains(badge),
      colour: channels(getComputedStyle(badge).backgroundColor), larger: parseFloat(getComputedStyle(badge).fontSize),
    },
    sentence: (document.querySelector(".verdict p") || {}).innerText,
  };
}
"""
