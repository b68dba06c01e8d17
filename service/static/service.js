"use strict";
(() => {
  // A submission that is not scored yet: its state is asked for every second.
  const live = document.getElementById("live");
  if (live?.dataset.state) {
    const ask = async () => {
      const answer = await fetch(live.dataset.state).catch(() => null);
      setTimeout(ask, 1000);
      if (!answer) document.getElementById("position").textContent = "the service does not answer; this page asks again";
      if (!answer?.ok) return;
      const { state, queue_position: position } = await answer.json();
      if (!["queued", "running"].includes(state)) { location.reload(); return; }
      const badge = live.querySelector(".state");
      badge.className = `state ${state}`;
      badge.textContent = state;
      document.getElementById("position").textContent =
        position ? `number ${position} in the queue` : state === "running" ? "being scored" : "";
    };
    setTimeout(ask, 1000);
  }

  // A form is sent once: the answer to a second click would hide the token that the first one shows.
  addEventListener("submit", event => {
    if (event.defaultPrevented || event.target.method !== "post") return;
    if (event.target.dataset.sent) event.preventDefault();
    event.target.dataset.sent = "yes";
  });
  addEventListener("pageshow", () => { for (const form of document.forms) delete form.dataset.sent; });

  // The submit page: files can be dropped, and the transfer has a progress bar.
  const form = document.getElementById("upload");
  if (form) {
    const drop = form.querySelector(".drop"), input = drop.querySelector("input");
    for (const kind of ["dragover", "dragleave", "drop"]) drop.addEventListener(kind, event => {
      event.preventDefault();
      drop.classList.toggle("over", kind === "dragover");
      if (kind === "drop" && event.dataTransfer.files.length) input.files = event.dataTransfer.files;
    });
    form.addEventListener("submit", event => {
      event.preventDefault();
      const bar = form.querySelector("progress"), button = form.querySelector("button.main");
      const problem = document.getElementById("problem"), request = new XMLHttpRequest();
      const failed = text => { problem.textContent = text; problem.hidden = false; bar.hidden = true; button.disabled = false; };
      button.disabled = true; bar.hidden = false; problem.hidden = true;
      request.upload.onprogress = ({ loaded, total }) => { bar.value = total ? loaded / total : 0; };
      const again = "Send the file again: it is never charged twice.";
      request.onerror = () => failed(`The connection was lost. ${again}`);
      request.onload = () => {
        if (request.status < 400) { location.href = request.responseURL; return; }
        const page = new DOMParser().parseFromString(request.responseText, "text/html");
        const own = page.querySelector("[role=alert]")?.textContent; // else the answer of a proxy
        failed(own ?? (request.status === 413 ? "The file is too large for the service's proxy." : `The service does not answer (status ${request.status}). ${again}`));
      };
      request.open("POST", form.action);
      request.send(new FormData(form));
    });
  }
})();
