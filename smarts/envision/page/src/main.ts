import "./style.css";
import { App } from "./app";

const app = new App();
document.body.append(app.element);
void app.start();
